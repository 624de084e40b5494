r"""Least time that every plan moves, whatever its mode sequence.

Let S = p . (x, y) + C(phi) + B_1(W_1) + B_2(W_2) be as in ``pose_bound``, but one for all phases:
it grows by at most 1 per second in every mode and every shape within the limits. Then every plan
moves for at least what S gains from start to goal, and nothing moves while metal melts or freezes:
both add up, for sequences whose bends are a choice too, and for all that begin alike.

The linear program takes the motions in the middle of boxes of shapes. Boxes in which the motions,
enclosed, let S grow too fast are halved then, and S is divided by what is left of its growth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.planning.bounds.bends import BendingTask
from twosra_mpc.planning.bounds.pose_bound import PoseConstraint, PoseProgram
from twosra_mpc.planning.bounds.pose_phases import Indices, PhaseMotions, PoseTask, pieces_of
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.modes import Mode
from twosra_mpc.timing import EventLayout

_FINE = 2  # boxes of each segment in a piece of its B
_CUTS = 800  # rows that are added at a time
_CLOSE, _HALVINGS, _MOST = 1.01, 6, 3000  # growth that is left, halvings, boxes to be halved
_SURELY = 1.1  # times what is enough, before it is proved
_TWO = 2  # segments


class _Boxes(NamedTuple):
    """Boxes of W, (2, m) each, and the pieces of B_1 and B_2 they lie in."""

    low: Array
    high: Array
    piece: Indices

    def some(self, which: NDArray[np.bool_]) -> _Boxes:
        return _Boxes(self.low[:, which], self.high[:, which], self.piece[:, which])

    def halved(self) -> _Boxes:
        """Each as four."""
        middle = (self.low + self.high) / 2
        quarters = [np.array(part)[:, None] for part in np.ndindex(2, 2)]
        low = np.hstack([np.where(upper, middle, self.low) for upper in quarters])
        high = np.hstack([np.where(upper, self.high, middle) for upper in quarters])
        return _Boxes(low, high, np.tile(self.piece, 4))


def least_motion_s(task: BendingTask, modes: Sequence[Mode]) -> float:
    """Lower bound on the time in which a plan with these modes moves [s]; 0 if none is known.

    Known of robots with two segments that drive no faster than some speed in any shape.
    """
    if task.pose is None or len(task.change) != _TWO:
        return 0.0
    known = [_motions(task.pose, mode, task, *_pieces(task)) for mode in modes]
    if any(phase is None for phase in known):
        return 0.0
    phases = [phase for phase in known if phase is not None]
    motions, slack, piece = (np.concatenate([phase[k] for phase in phases]) for k in range(3))
    everything = phases[0]._replace(motions=motions, slack=np.zeros_like(slack), piece=piece)
    layout = EventLayout(1, _TWO)
    cost = np.eye(layout.count)[layout.finish]
    given = task.pose, [everything], layout, layout.phase_order(), cost
    known_s = math.inf
    for side in task.pose.sides:
        known_s = _least_s(PoseProgram(*given, side, _CUTS), task, modes, known_s)
    return known_s


def _least_s(
    program: PoseProgram, task: BendingTask, modes: Sequence[Mode], enough_s: float
) -> float:
    """Bound of the plans on one side, or of those that are known to take less [s]."""

    def least_s(constraint: PoseConstraint) -> float:
        return constraint.need / max(float(constraint.rates[0]), 1e-300)

    found_s, best = program.best(least_s, _SURELY * enough_s)
    if best is None or found_s <= 0.0:
        return 0.0
    constraint, _ = program.read(best)
    grows = [_growth(program, best, mode, task, float(constraint.rates[0])) for mode in modes]
    return min(enough_s, constraint.need / max(grows))


def _pieces(task: BendingTask) -> tuple[_Boxes, PhaseMotions]:
    """Boxes of all shapes, and what is known of the pieces of B; the last one is for no bend."""
    pieces = [pieces_of(*ends) for ends in zip(task.change, task.room, strict=True)]
    bends, settled = (np.concatenate([*(piece[k] for piece in pieces), [0]]) for k in (1, 2))
    own, low, high, count = [], [], [], 0
    for w, (edges, each, _) in zip(task.origin, pieces, strict=True):
        at = np.arange(_FINE * len(each) + 1)
        ends = w + np.interp(at / _FINE, np.arange(len(edges)), edges)
        own.append(count + at[:-1] // _FINE)
        low.append(ends[:-1])
        high.append(ends[1:])
        count += len(each)
    lows, highs, where = (
        np.stack([axis.ravel() for axis in np.meshgrid(*axes)]) for axes in (low, high, own)
    )
    nothing = np.zeros((0, 4))
    none = np.zeros((0, _TWO), dtype=np.intp)
    return _Boxes(lows, highs, where), PhaseMotions(
        nothing, nothing, none, bends, settled.astype(bool)
    )


def _motions(
    pose: PoseTask, mode: Mode, task: BendingTask, boxes: _Boxes, empty: PhaseMotions
) -> PhaseMotions | None:
    """Motions of a mode in boxes of shapes; None if nothing limits it."""
    still = len(empty.bends) - 1
    if any(mode):
        piece = np.where(np.array(mode)[:, None], boxes.piece, still).T
        return pose.soft_boxes(mode, boxes.low, boxes.high, empty._replace(piece=piece))
    rooms = zip(task.origin, task.room, strict=True)
    least, most = zip(*((w + low, w + high) for w, (low, high) in rooms), strict=True)
    found = pose.rigid_phase(task.curvature(least), task.curvature(most))
    if found is None:
        return None
    piece = np.full((len(found.motions), _TWO), still, dtype=np.intp)
    return empty._replace(motions=found.motions, slack=found.slack, piece=piece)


def _growth(program: PoseProgram, x: Array, mode: Mode, task: BendingTask, known: float) -> float:
    """Proved growth of S in a mode; boxes are halved where it seems larger than known."""
    assert task.pose is not None
    boxes, empty = _pieces(task)
    p, slopes = x[:2] * program.given, program.slopes(x, 0)
    largest = known
    for halving in range(_HALVINGS + 1):
        phase = _motions(task.pose, mode, task, boxes, empty)
        assert phase is not None, "what limits the whole of a box limits its parts"
        growth, loose = program.growth(phase, p, *slopes)
        each = (growth.max(axis=2) + loose).max(axis=1)
        if not any(mode):
            return max(largest, float(each.max()))
        each = each.reshape(-1, boxes.low.shape[1]).max(axis=0)
        halve = each > _CLOSE * known
        if halving == _HALVINGS or not halve.any() or halve.sum() > _MOST:
            break
        largest = max(largest, float(each[~halve].max(initial=0.0)))
        boxes = boxes.some(halve).halved()
    return max(largest, float(each.max()))
