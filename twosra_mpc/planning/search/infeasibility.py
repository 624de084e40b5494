"""Infeasibility in words: which goal, which invariant, which limit, and what to change.

What is called impossible here holds for mode sequences of any length; what is said of sequences up
to a length is proved by the same relaxation that bounds their cost.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from twosra_mpc.planning.bounds.bends import BendingTask, bend_steps, unreachable_reason
from twosra_mpc.planning.bounds.stage_bounds import StageBounds
from twosra_mpc.planning.search.tree import Tree, tree_of
from twosra_mpc.robot.modes import (
    Mode,
    ModeSequence,
    all_modes,
    mode_name,
    rigid_mode,
    sequence_name,
)
from twosra_mpc.timing import TransitionModel

_FURTHER = 3  # how many phases beyond max_phases are looked at
_MOST_SEQUENCES = 1500  # how many sequences of one length are looked at


def impossibility(tree: Tree[Any]) -> str | None:
    """Say why no sequence of the allowed modes, however long, is a plan; None if not proved.

    Modes that the heaters cannot bring about occur in no sequence, and the invariants of
    ``unreachable_reason`` depend on the set of modes alone.
    """
    timing = tree.leaves.so_far.timing
    return tree.everywhere(lambda stage, _: _impossible(stage, timing))


def _impossible(stage: StageBounds, timing: TransitionModel) -> str | None:
    if (task := stage.bend) is None:
        return None
    if stage.last is not None and (refusal := timing.refusal((), stage.last)) is not None:
        end = f"goal.mode asks for {mode_name(stage.last)} at the end"
        return f"{end}: {refusal}; set heaters_at_once to 2 or ask for another goal.mode"
    usable = _usable(stage.modes, timing)
    reason = unreachable_reason(usable, task)
    if reason is None:
        return None
    allowed = f"allowed modes are {', '.join(map(mode_name, stage.modes))}"
    remedy = _remedy(usable, task, timing)
    refusals = [timing.refusal((mode,), stage.rigid) for mode in stage.modes if mode not in usable]
    if refusals and refusals[0] is not None:
        reason += f"; {refusals[0]}"
        if unreachable_reason(stage.modes, task) is None:
            remedy += ", or set heaters_at_once to 2"
    return f"{reason}; {allowed}: {remedy}"


def _usable(modes: Sequence[Mode], timing: TransitionModel) -> tuple[Mode, ...]:
    """The modes that some heating may bring about.

    A mode that is refused although everything freezes after it is refused in every sequence.
    """
    return tuple(mode for mode in modes if timing.refusal((mode,), rigid_mode(len(mode))) is None)


def _remedy(modes: tuple[Mode, ...], task: BendingTask, timing: TransitionModel) -> str:
    """The fewest further modes with which the invariants no longer forbid the shape."""
    missing = [mode for mode in _usable(all_modes(len(task.change)), timing) if mode not in modes]
    for count in range(1, len(missing) + 1):
        enough = [
            " with ".join(map(mode_name, more))
            for more in itertools.combinations(missing, count)
            if unreachable_reason((*modes, *more), task) is None
        ]
        if enough:
            return f"add {' or '.join(enough)}"
    return "ask for another shape"


def disproof(tree: Tree[Any]) -> str:
    """Say why the only sequence that the allowed modes make is no plan."""
    stage, *others = itertools.chain(*tree.variants)
    if others or stage.bend is None:
        return next(iter(tree.unreachable.values()), "no stage sequence is left")
    allowed = f"allowed modes are {', '.join(map(mode_name, stage.modes))}: add another mode"
    for sequence, words in tree.unreachable.items():
        return f"{_shape_limit(sequence, stage.bend) or words}; {allowed}"
    return f"there is no other mode sequence; {allowed}"


def too_few_phases(tree: Tree[Any]) -> str:
    """Say how many phases a plan of a single goal needs, where all of ``max_phases`` are disproved.

    The rigid phases that open and close a sequence count, whether anything moves in them or not.
    """
    ((stage,),) = tree.variants
    at_least, example = stage.most_phases + 1, ""
    for length in range(at_least, at_least + _FURTHER):
        if len(stage.modes) ** (length - 1) > _MOST_SEQUENCES:
            break
        if (found := _shortest(tree, stage, length)) is not None:
            example = f", possibly {sequence_name(found)}"
            break
        at_least = length + 1
    reasons = (_shape_limit(leaf, stage.bend) for leaf in tree.unreachable if stage.bend)
    because = next((f" ({reason})" for reason in reasons if reason), "")
    needed = f"a plan needs at least {at_least} phases{example}{because}"
    return f"{needed}, but max_phases is {stage.most_phases}: raise max_phases"


def _shape_limit(sequence: ModeSequence, task: BendingTask) -> str | None:
    """Say which limit forbids the bends of a sequence that leaves little choice of them."""
    for step in bend_steps(sequence, task, ()) or ():
        if not any(step.mode):
            continue
        who = f"in {sequence_name(sequence)}, mode {mode_name(step.mode)} would have to"
        if step.beyond is not None:
            return f"{who} bend segment {step.beyond + 1} {task.beyond} ({task.shape})"
        if (words := step.forbidden(task)) is not None:
            return f"{who} pass shapes whose {words} ({task.shape})"
    return None


def _shortest(tree: Tree[Any], stage: StageBounds, length: int) -> ModeSequence | None:
    """A sequence of this length that the relaxation does not disprove, the cheapest; or None."""
    stages, so_far = [[replace(stage, most_phases=length)]], tree.leaves.so_far
    known = tree.first, so_far.timing, so_far.weights, tree.leaves.relaxation
    deeper = tree_of(stages, *known, tree.solver, in_the_way=tree.in_the_way)
    opened, found = [deeper.root()], []
    while opened:
        node = opened.pop()
        leaf = deeper.whole(node)
        if leaf is not None and len(leaf.joined) == length:
            found.append((deeper.leaf_bound(node), leaf.joined))
        below = [child for child in deeper.children(node) if not deeper.too_deep(child)]
        opened += [child for child in below if deeper.bound(child) < math.inf]
    bound, leaf_found = min(found, default=(math.inf, None))
    return leaf_found if bound < math.inf else None
