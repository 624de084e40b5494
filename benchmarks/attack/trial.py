"""What the planner proves of an attack, and whether it holds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from benchmarks.attack.attacks import Attack
from twosra_mpc import InputError, Status, plan
from twosra_mpc.planning.relaxation import stage_tree
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.stages.variants import ways_of
from twosra_mpc.robot.modes import sequence_name

_MOST_PHASES = 12  # that a problem may allow


class Claim(NamedTuple):
    """What is proved of all plans to which an attack belongs: none costs less than ``bound``."""

    of: str
    bound: float


def claims(attack: Attack, tighter: bool) -> Iterator[Claim]:
    """Yield what the search tree says of the nodes above an attack's sequence, and of itself."""
    problem = attack.problem.with_values(max_phases=_MOST_PHASES)
    tree: Tree[None] = stage_tree(problem, ways_of(problem).variants, lambda *_: ())
    leaf, node = attack.sequence, tree.root()
    while True:
        yield Claim(f"node {sequence_name(node.head)}", tree.bound(node))
        if (whole := tree.whole(node)) is not None and whole.joined == leaf:
            break
        assert len(node.head) < len(leaf), f"{sequence_name(leaf)} is no leaf of the tree"
        node = Node(0, (), leaf[: len(node.head) + 1])
    bound = tree.leaf_bound(node)
    yield Claim(f"leaf {sequence_name(leaf)}", bound)
    if tighter and math.isfinite(bound):
        yield Claim(f"tighter {sequence_name(leaf)}", tree.tighter_bound(node, math.inf))


def planned(attack: Attack, work_limit: float) -> tuple[str, Claim]:
    """What a whole search says: its status, and its bound, which its own plan respects too."""
    try:
        result = plan(attack.problem.with_values(work_limit=work_limit))
    except InputError as error:
        return "refused", Claim(f"plan refuses: {error}", math.inf)
    lower = result.lower_bound or 0.0
    if result.status is Status.INFEASIBLE:
        lower = math.inf
    assert result.plan is None or result.plan.cost.total >= lower
    return result.status, Claim(f"plan ({result.status}: {result.message})", lower)
