"""Plans made quicker than they can be, by all that verification may forgive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np

from twosra_mpc.checking.between_samples import between_problems
from twosra_mpc.checking.resampling import refined
from twosra_mpc.checking.verification import verify
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Samples, Trajectory, wheel_speeds
from twosra_mpc.robot.coordinates import Array

Random = np.random.Generator


def forgery(plan: Plan, seed: int) -> tuple[str, Trajectory]:
    """What may make a plan quicker, in words, and the plan so changed; the same every time."""
    rng = np.random.default_rng(seed)
    names = list(_KINDS)
    kinds = [names[i] for i in rng.choice(len(names), rng.integers(1, 3), replace=False)]
    made = plan.trajectory
    if rng.random() < 0.2:
        kinds, made = ["refined", *kinds], refined(plan, 10 ** rng.uniform(-1, 0.5)).trajectory
    for kind in kinds:
        if kind in _KINDS:
            made = _KINDS[kind](made, rng)
    return ", ".join(kinds), made


def accepted(made: Trajectory) -> bool:
    """Whether verification, also that between samples, finds nothing wrong."""
    return verify(made).ok and not any(between_problems(made))


def _warped(made: Trajectory, when: Callable[[Array], Array]) -> Trajectory:
    """The same motion on another clock, which runs evenly from one sample to the next."""
    samples = made.samples
    t_s = when(samples.t_s)
    pace = np.append(np.diff(samples.t_s) / np.diff(t_s), 1.0)[:, None]
    v, a = samples.v * pace, samples.a * pace**2
    wheels = np.zeros_like(samples.wheel_rad_s)
    rows = np.flatnonzero(samples.moves)
    q, mode = samples.q[rows], samples.mode[rows]
    wheels[rows] = wheel_speeds(made.problem.robot, q, v[rows], mode)
    phases = tuple(
        p._replace(start_s=_at(when, p.start_s), end_s=_at(when, p.end_s)) for p in made.phases
    )
    transitions = tuple(
        m._replace(
            heater_s=_at(when, m.heater_s), onset_s=_at(when, m.onset_s), done_s=_at(when, m.done_s)
        )
        for m in made.transitions
    )
    samples = replace(samples, t_s=t_s, v=v, a=a, wheel_rad_s=wheels)
    return replace(made, samples=samples, phases=phases, transitions=transitions)


def _at(when: Callable[[Array], Array], t_s: float) -> float:
    return float(when(np.array([t_s]))[0])


def _squeezed(made: Trajectory, rng: Random) -> Trajectory:
    """All of it quicker by the same share."""
    share = 1 - 10 ** rng.uniform(-9, -2)
    return _warped(made, lambda t: t * share)


def _cut_short(made: Trajectory, rng: Random) -> Trajectory:
    """Less time from one sample to the next, of which some rest and some move."""
    t = made.samples.t_s
    rows = rng.choice(len(t) - 1, rng.integers(1, 6))
    less = np.zeros(len(t) - 1)
    less[rows] = np.minimum(10 ** rng.uniform(-9, -1, len(rows)), 0.5 * np.diff(t)[rows])
    moved = t - np.append(0.0, np.cumsum(less))
    return _warped(made, lambda at: np.interp(at, t, moved))


def _fewer(made: Trajectory, rng: Random) -> Trajectory:
    """Without some of the samples that no event is at."""
    samples = made.samples
    events = [*(p[1:] for p in made.phases), *(m[2:] for m in made.transitions)]
    known = np.array([t for times in events for t in times])
    kept = np.abs(samples.t_s[:, None] - known).min(axis=1) < 1e-6
    kept |= rng.random(len(samples)) < rng.choice([0.0, 0.5, 0.9, 0.99])
    kept[[0, -1]] = True
    less = {item.name: getattr(samples, item.name)[kept] for item in fields(Samples)}
    return replace(made, samples=Samples(**less))


def _told_earlier(made: Trajectory, rng: Random) -> Trajectory:
    """A transition that is said to end earlier, and all that follows so much earlier."""
    if not made.transitions:
        return made
    chosen = rng.integers(len(made.transitions))
    less, done_s = 10 ** rng.uniform(-9, -1), made.transitions[chosen].done_s
    return _warped(made, lambda at: np.where(at >= done_s - 1e-7, at - less, at))


def _missed(made: Trajectory, rng: Random) -> Trajectory:
    """Inputs that are all a little less: it ends short of its goal, in as much less time."""
    share = 1 - 10 ** rng.uniform(-10, -4)
    samples = made.samples
    scaled = replace(samples, v=samples.v * share, a=samples.a * share)
    return _warped(replace(made, samples=scaled), lambda t: t * share)


_KINDS: dict[str, Callable[[Trajectory, Random], Trajectory]] = {
    "squeezed": _squeezed,
    "cut short": _cut_short,
    "fewer samples": _fewer,
    "told earlier": _told_earlier,
    "goal missed": _missed,
}
