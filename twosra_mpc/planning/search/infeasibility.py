"""Why there is no plan, in words: which goal, which invariant, which limit, and what to change.

What is called impossible here holds for mode sequences of any length; what is said of sequences up
to a length is proved by the same relaxation that bounds their cost.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from twosra_mpc.planning.search.bends import BendingTask, bend_steps, unreachable_reason
from twosra_mpc.planning.search.mode_tree import ModeTree
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


def impossibility(tree: ModeTree[Any]) -> str | None:
    """Say why no sequence of the allowed modes, however long, is a plan; None if not proved.

    Modes that the heaters cannot bring about occur in no sequence, and the invariants of
    ``unreachable_reason`` depend on the set of modes alone.
    """
    if (refusal := tree.timing.refusal((), tree.last)) is not None:
        end = f"goal.mode asks for {mode_name(tree.last)} at the end"
        return f"{end}: {refusal}; set heaters_at_once to 2 or ask for another goal.mode"
    usable = _usable(tree.modes, tree.timing)
    reason = unreachable_reason(usable, tree.task)
    if reason is None:
        return None
    allowed = f"allowed modes are {', '.join(map(mode_name, tree.modes))}"
    remedy = _remedy(usable, tree.task, tree.timing)
    refusals = [
        tree.timing.refusal((mode,), tree.rigid) for mode in tree.modes if mode not in usable
    ]
    if refusals and refusals[0] is not None:
        reason += f"; {refusals[0]}"
        if unreachable_reason(tree.modes, tree.task) is None:
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


def disproof(tree: ModeTree[Any]) -> str:
    """Say why the only sequence that the allowed modes make is no plan."""
    allowed = f"allowed modes are {', '.join(map(mode_name, tree.modes))}: add another mode"
    for sequence, words in tree.unreachable.items():
        return f"{_shape_limit(sequence, tree.task) or words}; {allowed}"
    return f"there is no other mode sequence; {allowed}"


def too_few_phases(tree: ModeTree[Any]) -> str:
    """Say how many phases a plan needs, where every sequence of ``max_phases`` is disproved.

    The rigid phases that open and close a sequence count, whether anything moves in them or not.
    """
    at_least, example = tree.max_phases + 1, ""
    for length in range(at_least, at_least + _FURTHER):
        if len(tree.modes) ** (length - 1) > _MOST_SEQUENCES:
            break
        if (found := _shortest(tree, length)) is not None:
            example = f", possibly {sequence_name(found)}"
            break
        at_least = length + 1
    reasons = (_shape_limit(leaf, tree.task) for leaf in tree.unreachable)
    because = next((f" ({reason})" for reason in reasons if reason), "")
    needed = f"a plan needs at least {at_least} phases{example}{because}"
    return f"{needed}, but max_phases is {tree.max_phases}: raise max_phases"


def _shape_limit(sequence: ModeSequence, task: BendingTask) -> str | None:
    """Say which limit forbids the bends of a sequence that leaves little choice of them."""
    for step in bend_steps(sequence, task) or ():
        if not any(step.mode):
            continue
        who = f"in {sequence_name(sequence)}, mode {mode_name(step.mode)} would have to"
        if step.beyond is not None:
            return f"{who} bend segment {step.beyond + 1} {task.beyond} ({task.shape})"
        words = task.forbidden(step.mode, step.before, step.surely)
        if words is not None:
            return f"{who} pass shapes whose {words} ({task.shape})"
    return None


def _shortest(tree: ModeTree[Any], length: int) -> ModeSequence | None:
    """A sequence of this length that the relaxation does not disprove, the cheapest; or None."""
    deeper = replace(tree, max_phases=length, unreachable={}, _bounds={})
    nodes, found = [deeper.root()], []
    while nodes:
        node = nodes.pop()
        leaf = deeper.leaf(node)
        if leaf is not None and len(leaf) == length:
            found.append((deeper.leaf_bound(node), leaf))
        longer = [child for child in deeper.children(node) if not deeper.too_deep(child)]
        nodes += [child for child in longer if deeper.bound(child) < math.inf]
    bound, leaf = min(found, default=(math.inf, None))
    return leaf if bound < math.inf else None
