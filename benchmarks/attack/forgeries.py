"""Plan files told otherwise: quicker or cheaper by all that verification might forgive."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from twosra_mpc.checking.plan_file import check_plan, refined
from twosra_mpc.checking.verification import cost_of, verify
from twosra_mpc.errors import InputError
from twosra_mpc.plans.plan import Plan, Status
from twosra_mpc.plans.result import Result
from twosra_mpc.plans.trajectory import Samples, Trajectory, wheel_speeds
from twosra_mpc.robot.coordinates import Array

Random = np.random.Generator
Document = dict[str, Any]


def forged_file(result: Result, seed: int) -> tuple[str, Document]:
    """What may make a plan cheaper, in words, and a plan file that says so; the same every time.

    Half of them are motions told otherwise, with costs and bounds that fit; the others, and some of
    these, state numbers that do not follow from the motion.
    """
    rng = np.random.default_rng(seed)
    made, words = result.require().trajectory, list[str]()
    if rng.random() < 0.5:
        how, made = forgery(result.require(), seed)
        words.append(how)
    document, names = _fitting(result, made), list(_CLAIMS)
    if not words or rng.random() < 0.2:
        words.append(names[rng.integers(len(names))])
        _CLAIMS[words[-1]](document, rng)
    return ", ".join(words), document


def cost_if_accepted(document: Document, path: Path) -> float | None:
    """What a plan file says it costs, written to ``path``, if verification finds nothing wrong."""
    path.write_text(json.dumps(document), encoding="utf-8")
    try:
        found = check_plan(path)
    except InputError:
        return None
    return float(document["cost"]["total"]) if found.ok else None


def _fitting(result: Result, made: Trajectory) -> Document:
    """A plan file of a motion, with costs, status and verification as a forger would state them."""
    plan, cost = result.require(), cost_of(made)
    bound = min(result.lower_bound or 0.0, cost.total)
    told = replace(verify(made), ok=True, problems=())
    told_cheaper = replace(
        plan,
        trajectory=made,
        cost=cost,
        verification=told,
        lower_bound=bound,
        fastest_cost=cost.total,
    )
    status = Status.OPTIMAL if (told_cheaper.gap or 0.0) <= plan.problem.gap else Status.FEASIBLE
    forged = replace(result, plan=told_cheaper, lower_bound=bound, status=status)
    document: Document = json.loads(json.dumps(forged.to_dict()))
    return document


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


def _less_current(made: Trajectory, rng: Random) -> Trajectory:
    """Heaters that give a little less, some of the time."""
    current = made.samples.heater_current_A.copy()
    current[rng.random(len(current)) < rng.choice([0.1, 0.5, 1.0])] *= 1 - 10 ** rng.uniform(
        -11, -2
    )
    return replace(made, samples=replace(made.samples, heater_current_A=current))


def _repeated(made: Trajectory, rng: Random) -> Trajectory:
    """Samples that stand there twice, so much apart."""
    samples = made.samples
    rows = np.sort(rng.choice(len(samples) - 1, rng.integers(1, 5)))
    more = {item.name: getattr(samples, item.name)[rows] for item in fields(Samples)}
    more["t_s"] = more["t_s"] + 10 ** rng.uniform(-10, -5)
    whole = {
        name: np.insert(getattr(samples, name), rows + 1, values, axis=0)
        for name, values in more.items()
    }
    order = np.argsort(whole["t_s"], kind="stable")
    return replace(made, samples=Samples(**{name: each[order] for name, each in whole.items()}))


def _shifted(made: Trajectory, rng: Random) -> Trajectory:
    """Inputs, shapes or heaters that are a sample late."""
    names = ["q", "v", "a", "wheel_rad_s", "heater_current_A", "temperature_C"]
    late = {name: np.roll(getattr(made.samples, name), 1, axis=0) for name in [rng.choice(names)]}
    return replace(made, samples=replace(made.samples, **late))


def _scaled(made: Trajectory, rng: Random) -> Trajectory:
    """One kind of samples, all a little smaller."""
    name = rng.choice(["q", "v", "a", "wheel_rad_s", "temperature_C", "melt_fraction"])
    less = getattr(made.samples, name) * (1 - 10 ** rng.uniform(-12, -4))
    return replace(made, samples=replace(made.samples, **{name: less}))


_KINDS: dict[str, Callable[[Trajectory, Random], Trajectory]] = {
    "squeezed": _squeezed,
    "cut short": _cut_short,
    "fewer samples": _fewer,
    "told earlier": _told_earlier,
    "goal missed": _missed,
    "less current": _less_current,
    "samples repeated": _repeated,
    "samples late": _shifted,
    "samples scaled": _scaled,
}


def _cheaper(document: Document, rng: Random) -> None:
    """Less of what makes up the cost, and a total that fits."""
    cost, weights = document["cost"], document["scenario"]["weights"]
    name = rng.choice(["energy_J", "effort_s", "time_s", "total", "transitions"])
    before = cost[name]
    cost[name] = before - 1 if name == "transitions" else before * (1 - 10 ** rng.uniform(-10, -2))
    if name != "total":
        price = {"energy_J": "energy_s_per_J", "effort_s": "effort", "transitions": "transition_s"}
        each = weights[price[name]] if name in price else 1.0
        cost["total"] -= each * (before - cost[name])
    if name == "time_s":
        document["duration_s"] = cost["time_s"]
    _settled(document)


def _weighed(document: Document, rng: Random) -> None:
    """Another weight; the total keeps, or follows the weight alone."""
    weights, cost = document["scenario"]["weights"], document["cost"]
    name, of = [("energy_s_per_J", "energy_J"), ("effort", "effort_s")][rng.integers(2)]
    less = weights[name] * 10 ** rng.uniform(-9, -1)
    if rng.random() < 0.5:
        weights[name] -= less
    cost["total"] -= less * cost[of]
    _settled(document)


def _settled(document: Document) -> None:
    """Gaps and status that follow from cost and bound."""
    total, bound = document["cost"]["total"], document["lower_bound_s"]
    document["gap"] = document["search_gap"] = max(0.0, (total - bound) / total)
    document["fastest_cost_s"] = total
    near = document["gap"] <= document["scenario"]["gap"]
    document["status"] = "optimal" if near else "feasible"


def _other_bound(document: Document, rng: Random) -> None:
    """A bound, a gap or a cost at full speed that nobody proved."""
    name = rng.choice(["lower_bound_s", "gap", "search_gap", "fastest_cost_s"])
    document[name] *= 1 + rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(-10, -1)
    if name == "lower_bound_s" and rng.random() < 0.8:
        _settled(document)


def _other_robot(document: Document, rng: Random) -> None:
    """A number of the robot that is another, under the same name."""
    known = list(_numbers(document["robot"]))
    place, key = known[rng.integers(len(known))]
    place[key] *= 1 + 10 ** rng.uniform(-12, 0)


def _numbers(value: Any) -> Iterator[tuple[Any, Any]]:
    """Where numbers are that are not zero, in lists and tables within each other."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            if isinstance(item, float) and item:
                yield value, key
            yield from _numbers(item)


def _other_certificate(document: Document, rng: Random) -> None:
    """A certificate that claims more: of itself, or of what it opens and prices."""
    certificate = document["certificate"]
    certificate["bound_s"] *= 1 + 10 ** rng.uniform(-9, 0)
    if certificate["opened"] and rng.random() < 0.5:
        del certificate["opened"][rng.integers(len(certificate["opened"]))]
    for leaf in certificate.get("priced", ()):
        share = 10 ** rng.uniform(-3, 3)
        leaf["edges"] = [share * price for price in leaf["edges"]]
        leaf["slopes"] = [price / share for price in leaf["slopes"]]
        leaf["bends"] = [[share * price for price in row] for row in leaf["bends"]]


_CLAIMS: dict[str, Callable[[Document, Random], None]] = {
    "a lower cost": _cheaper,
    "other weights": _weighed,
    "another bound": _other_bound,
    "another robot": _other_robot,
    "another certificate": _other_certificate,
}
