"""When phases begin: melts and freezes as early as physics allows, one gap after the other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.attack.heat import Constants, Heated, Item
from twosra_mpc.robot.modes import Mode, ModeSequence, is_rigid
from twosra_mpc.robot.timing import SequentialTiming


@dataclass(frozen=True)
class Timeline:
    """What happens when.

    Attributes:
        starts_s: Of the phases.
        finish_s: End of the plan.
        items: Melts and freezes.
        energy_J: Of all heaters until the end.
    """

    starts_s: tuple[float, ...]
    finish_s: float
    items: tuple[Item, ...]
    energy_J: float


def overlapping(
    segments: Sequence[Heated],
    modes: Sequence[Mode],
    durations: Sequence[float],
    one_heater: bool,
    rng: np.random.Generator,
) -> Timeline | None:
    """Let segments melt and freeze while the robot moves; None where that is not possible.

    Args:
        segments: At t = 0.
        modes: Stiffness at t = 0, in each phase, and at the end.
        durations: Of the phases [s].
        one_heater: Whether at most one heater is on at a time.
        rng: Decides what waits although it need not.
    """
    now, end, starts, items = list(segments), 0.0, [], list[Item]()
    off = [0.0] * len(now)  # when each heater last went off
    coasting: dict[int, Item] = {}  # off already, and still liquid
    for gap, (before, after) in enumerate(itertools.pairwise(modes)):
        made: list[Item] = []
        changing = [j for j in range(len(now)) if before[j] != after[j]]
        for j in [j for j in changing if before[j]]:
            if j in coasting:
                item = coasting.pop(j)
                if item.onset_s < end:
                    return None
            else:
                now[j], item = now[j].frozen(end)
            off[j] = item.heater_s
            made.append(item)
        latest = max([end, *(item.done_s for item in made)])
        for j in rng.permutation([j for j in changing if not before[j]]).tolist():
            others = [k for k in range(len(now)) if k != j]
            if one_heater:
                for k in [k for k in others if now[k].heater_on]:
                    wait = rng.choice([0.0, 0.05, 0.2, 1.0]) * rng.random() * now[k].ready_s
                    now[k], coasting[k] = now[k].switched_off(now[k].ready_s + wait)
                    off[k] = coasting[k].heater_s
            free = max((off[k] for k in others), default=0.0) if one_heater else 0.0
            if (found := now[j].melted(end, free)) is None:
                return None
            spare = latest - found[1].done_s
            if spare > 0 and rng.random() < 0.7:  # no sooner than needed: colder, less held
                later = now[j].melted(found[1].onset_s + spare, free)
                found = later if later and later[1].done_s <= latest + 1e-7 else found
            now[j], item = found
            made.append(item)
            latest = max(latest, item.done_s)
        items += made
        end = latest
        if gap < len(durations):
            starts.append(end)
            end += durations[gap]
    if coasting:
        return None
    return Timeline(tuple(starts), end, tuple(items), sum(one.energy_J(end) for one in now))


def waited_through(
    times: SequentialTiming, heat: Constants, modes: Sequence[Mode], durations: Sequence[float]
) -> Timeline:
    """Let the robot stand still through every change of mode, for the waits of its authors."""
    end, starts, items, energy = 0.0, [], list[Item](), 0.0
    on = {j: 0.0 for j, soft in enumerate(modes[0]) if soft}  # held liquid since
    for gap, (before, after) in enumerate(itertools.pairwise(modes)):
        begin = end
        if before != after:
            if is_rigid(before):
                end, heated = begin + times.heat_s, begin
            elif is_rigid(after):
                end = heated = begin + times.freeze_s
            else:
                end, heated = begin + times.reconfigure_s, begin + times.reconfigure_cool_s
            for j, soft in enumerate(before):
                if soft:
                    energy += heat.hold_W * (begin - on.pop(j))
                    items.append(Item(j, "rigid", begin, begin, heated))
            for j, soft in enumerate(after):
                if soft:
                    energy += heat.full_W * (end - heated)
                    on[j] = end
                    items.append(Item(j, "soft", heated, heated, end))
        if gap < len(durations):
            starts.append(end)
            end += durations[gap]
    energy += sum(heat.hold_W * (end - since) for since in on.values())
    return Timeline(tuple(starts), end, tuple(items), energy)


def canonical(
    first: Mode, sequence: ModeSequence, last: Mode, modes: Sequence[Mode]
) -> ModeSequence:
    """The sequence with the rigid phases that open and close it, of no length."""
    rigid = (0,) * len(first)
    if rigid in modes and first == rigid and sequence[:1] != (rigid,):
        sequence = (rigid, *sequence)
    if rigid in modes and last == rigid and sequence[-1:] != (rigid,):
        sequence = (*sequence, rigid)
    return sequence
