"""The plan: a motion on the clock with its cost, its verification and its proof; always whole.

`headline` and `quality` say in words what the search proved, and what the plan is slower on
purpose.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, NoReturn

import numpy as np

from twosra_mpc.arguments import Word, public
from twosra_mpc.errors import InputError, NoPlanError
from twosra_mpc.planning.bounds.schedule import feasible_schedule
from twosra_mpc.plans.carried import mission_document, object_poses
from twosra_mpc.plans.trajectory import Phase, Samples, Trajectory
from twosra_mpc.problem.problem import Problem, Start
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.modes import Mode, ModeSequence, sequence_name
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.network import EventLayout
from twosra_mpc.timing.thermal import confirmed_model
from twosra_mpc.validation import ArrayValue

_SOON_S = 0.05  # after its end: no time of its own
_SAME = 1e-9  # of a cost: no more than rounding


class Status(Word):
    """Status of a problem's plan."""

    OPTIMAL = "optimal"  # verified, proved within the asked gap of the best possible
    FEASIBLE = "feasible"  # verified; the gap is larger than asked, or not known
    INFEASIBLE = "infeasible"  # proved that there is no plan
    FAILED = "failed"  # no verified plan found, nothing proved

    @property
    def words(self) -> str:
        """The status; where nothing is known, that this is undecided."""
        undecided = " (undecided: neither a plan nor a proof that there is none)"
        return f"{self}{undecided if self is Status.FAILED else ''}"


class Cost(NamedTuple):
    """Cost of a plan in s, and what it is made of; files of older versions say no effort."""

    total: float
    time_s: float
    energy_J: float
    transitions: int
    effort_s: float | None = None


@dataclass(frozen=True, eq=False)
class Verification(ArrayValue):
    """Findings of the independent re-integration and checking of a plan.

    Attributes:
        max_defect: Largest difference between the samples and their re-integration [m, rad, 1/m].
        goal_error: Distance to the goal box of each coordinate after re-integration.
        limits: Name of each limit -> margin left (negative: violated), unit in the name.
        ok: Whether everything holds.
        problems: What does not hold, in words.
    """

    max_defect: float
    goal_error: tuple[float, ...]
    limits: Mapping[str, float]
    ok: bool
    problems: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The findings as plain data; None for a number that is not finite."""
        numbers = (self.max_defect, *self.goal_error)
        defect, *errors = (number if math.isfinite(number) else None for number in numbers)
        written = {"max_defect": defect, "goal_error": errors, "limits": dict(self.limits)}
        return {**vars(self), **written, "problems": list(self.problems)}


_OF_RESULT = ("certificate", "ending", "found", "message", "plan", "save", "stats")


@public
@dataclass(frozen=True, eq=False)
class Plan(ArrayValue):
    """A plan: what happens at any time, what it costs, and what is proved of it.

    Attributes:
        planner: "optimal" or "greedy".
        trajectory: Problem, samples, phases and transitions.
        cost: What it costs.
        verification: Outcome of the independent check.
        lower_bound: Proved lower bound on the cost of any plan [s]; None by the greedy rule.
        fastest_cost: Cost of the plan that the search found, at full speed [s]: with the same mode
            sequence and path, before it was made gentle. It is ``cost.total`` where nothing is
            slower on purpose; None where a file of an older version does not say.
        confirmed_lower_bound: Proved lower bound on ``confirmed_s`` of any plan [s], where
            `confirmed_lower_bound` was asked for it, as ``twosra plan`` does.
    """

    planner: str
    trajectory: Trajectory
    cost: Cost
    verification: Verification
    lower_bound: float | None
    fastest_cost: float | None
    confirmed_lower_bound: float | None = None

    def __getattr__(self, name: str) -> NoReturn:
        """Say what its result has instead.

        Raises:
            AttributeError: Always; a plan has no further attributes.
        """
        hint = "; the result that it is of has one" if name in _OF_RESULT else ""
        raise AttributeError(f"a Plan has no {name}{hint}", name=name, obj=self)

    @property
    def problem(self) -> Problem:
        """The problem planned for (robot included)."""
        return self.trajectory.problem

    @property
    def robot(self) -> Robot:
        """The robot planned for."""
        return self.problem.robot

    @property
    def samples(self) -> Samples:
        """The plan on its own grid."""
        return self.trajectory.samples

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Motion phases in order."""
        return self.trajectory.phases

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """Melts and freezes by heater time."""
        return self.trajectory.transitions

    @property
    def duration_s(self) -> float:
        """Time from start to the end of the last phase or transition."""
        return self.trajectory.duration_s

    @property
    def moving_s(self) -> float:
        """Time spent in motion phases."""
        return sum(phase.end_s - phase.start_s for phase in self.phases)

    @property
    def sequence(self) -> ModeSequence:
        """Mode of each motion phase."""
        return tuple(phase.mode for phase in self.phases)

    @property
    def last_mode(self) -> Mode:
        """Mode that it ends in: the goal's, or as the last task leaves the segments."""
        mode = list(self.problem.start_mode)
        for item in sorted(self.transitions, key=lambda item: item.done_s):
            mode[item.segment - 1] = int(item.to == "soft")
        return tuple(mode)

    @property
    def confirmed_s(self) -> float | None:
        """Time until a robot exactly as described is known to have carried it out [s].

        ``duration_s`` is when the metal is as planned; a run goes on when it knows. None if the
        segments are not described, or heaters that are told so late cannot make the phases.
        """
        return None if self._confirmed is None else float(self._confirmed[self._events.finish])

    def known_end_s(self, phase: int) -> float:
        """Time at which a run is at the end of a phase (from 0) [s]; as planned where unknown."""
        known = self._confirmed
        return self.phases[phase].end_s if known is None else float(known[self._events.end(phase)])

    @property
    def _events(self) -> EventLayout:
        return EventLayout(len(self.phases), len(self.last_mode))

    @cached_property
    def _confirmed(self) -> Array | None:
        """Times of all events as they are confirmed."""
        model = confirmed_model(self.problem)
        if model is None:
            return None
        lasting = np.array([phase.end_s - phase.start_s for phase in self.phases])
        network = model.network(self.sequence, self.last_mode, [0.0] * len(lasting))
        found = feasible_schedule(network, lasting, model.problem, model)
        return None if found is None else found[0]

    @property
    def gap(self) -> float | None:
        """Proved relative gap (cost - lower bound) / cost; None without a lower bound."""
        return relative_gap(self.cost.total, self.lower_bound)

    @property
    def search_gap(self) -> float | None:
        """Relative gap of the same plan at full speed, which the search proved; None if unknown."""
        return relative_gap(self.fastest_cost, self.lower_bound)

    @property
    def slower_by(self) -> float | None:
        """Cost beyond that at full speed, on purpose [s]; None if not known."""
        if self.fastest_cost is None:
            return None
        more = self.cost.total - self.fastest_cost
        return more if more > _SAME * self.cost.total else 0.0

    @property
    def status(self) -> Status:
        """Status by verification and gap."""
        if not self.verification.ok:
            return Status.FAILED
        proved = self.gap is not None and self.gap <= self.problem.gap
        return Status.OPTIMAL if proved else Status.FEASIBLE

    def require(self) -> Plan:
        """Return the plan, which is verified: what sends or writes set-points asks here first.

        Raises:
            NoPlanError: If verification found something wrong.
        """
        if not self.verification.ok:
            raise NoPlanError(Status.FAILED, f"it does not verify: {self.verification.problems[0]}")
        return self

    def check_robot(self, robot: Robot) -> None:
        """Check that the plan is for a robot.

        Raises:
            InputError: If it is for another, or one with other values.
        """
        if self.robot != robot:
            allowed = f"a plan for this very robot, {robot.name}, with all its values"
            raise InputError("plan.robot", self.robot.name, allowed)

    def rest_at(self, time_s: float) -> Problem:
        """The problem that is left at a time, to be planned again from the plan's own state then.

        The robot is where the plan has it, and rests; its metal may be changing; tasks that are
        done, in the plan's order, are left out.

        Raises:
            InputError: If the time is not within the plan.
        """
        trajectory, problem = self.trajectory, self.problem
        if not 0.0 <= time_s <= trajectory.duration_s:
            raise InputError("time_s", time_s, f"from 0 to {trajectory.duration_s:zg} s")
        left = problem.tasks[sum(done_s <= time_s for done_s in trajectory.done_s) :]
        given = {"start": start_at(trajectory, time_s), "objects": objects_at(trajectory, time_s)}
        return problem.with_values(**given, tasks=left)

    def __str__(self) -> str:
        return f"{sequence_name(self.sequence)}: {headline(self)}"

    def __repr__(self) -> str:
        return f"<Plan {self}>"

    def _repr_html_(self) -> str:
        """The plan's figure, for notebooks."""
        from twosra_mpc.plotting.plan_figures import plan_html  # no one else waits for matplotlib

        return plan_html(self)

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain data, as in the published file format."""
        tasks = self.problem.tasks or self.problem.objects
        return {
            "scenario": self.problem.scenario(),
            "planner": self.planner,
            "duration_s": self.duration_s,
            "lower_bound_s": self.lower_bound,
            "confirmed_duration_s": self.confirmed_s,
            "confirmed_lower_bound_s": self.confirmed_lower_bound,
            "gap": self.gap,
            "fastest_cost_s": self.fastest_cost,
            "search_gap": self.search_gap,
            "cost": self.cost._asdict(),
            "phases": [phase._asdict() for phase in self.phases],
            "transitions": [transition._asdict() for transition in self.transitions],
            "samples": self.samples.to_dict(),
            "verification": self.verification.to_dict(),
            **(mission_document(self.trajectory) if tasks else {}),
        }


def relative_gap(cost: float | None, lower_bound: float | None) -> float | None:
    """Relative gap (cost - lower bound) / cost; None where one of them is not known."""
    if cost is None or lower_bound is None:
        return None
    return max(0.0, (cost - lower_bound) / cost) if cost else 0.0


_ROUNDING = 1e-5  # of a cost: no smaller gap is claimed in words


def percent(share: float) -> str:
    """Write a share in per cent with two digits that count, and a tiny one as what it is below."""
    return "< 0.001 %" if 0 < share < 1e-5 else f"{float(f'{100 * share:z.2g}'):zg} %"


def quality(plan: Plan) -> str:
    """Say how near to the best possible a plan is, and what it would cost at full speed.

    E.g. "driven gently; at full speed 338.0 s, proved within 0.006 % of the best".
    """
    if plan.lower_bound is None or plan.gap is None:
        return "no bound proved"
    if not plan.slower_by or plan.fastest_cost is None or plan.search_gap is None:
        return within(plan.gap)
    quickest = f"{_costs(plan)}{plan.fastest_cost:z.1f} s"
    return f"driven gently; at full speed {quickest}, {within(plan.search_gap)}"


def headline(plan: Plan) -> str:
    """Say what a plan costs, and how good that is, in a line without its modes."""
    known = f"by the {plan.planner} rule" if plan.lower_bound is None else quality(plan)
    comma = " " if plan.lower_bound is None else ", "
    return f"{_costs(plan)}{plan.cost.total:z.1f} s{comma}{known}"


def planned_words(plan: Plan) -> str:
    """Say how long a plan takes, and how long until runs know that it is done."""
    known_s = plan.confirmed_s
    later = known_s is not None and known_s > plan.duration_s + _SOON_S
    return f"{plan.duration_s:z.1f} s" + (f", {known_s:z.1f} s as confirmed" if later else "")


def as_confirmed(plan: Plan) -> str:
    """Say how long it takes until runs know that a plan is done, and any; nothing if unknown."""
    if plan.confirmed_s is None:
        return ""
    least_s = plan.confirmed_lower_bound
    bound = "" if least_s is None else f"; no plan in less than {least_s:z.2f} s"
    return f"{plan.confirmed_s:z.2f} s until all melts and freezes are confirmed{bound}"


def above_bound(plan: Plan) -> str:
    """Say how much above the lower bound a plan is, and how much of it on purpose."""
    if plan.lower_bound is None:
        return ""
    above = f"{max(plan.cost.total - plan.lower_bound, 0.0):z.2f} s above it"
    if not plan.slower_by:
        return above
    return f"{above}, {plan.slower_by:z.2f} s of them on purpose"


def within(gap: float) -> str:
    """Say that no plan is better by more than a relative gap; rounding is counted as a gap."""
    return f"proved within {percent(max(gap, _ROUNDING))} of the best"


def _costs(plan: Plan) -> str:
    """Prefix of a number of seconds that is not only time."""
    return "cost " if any(plan.problem.weights.model_dump().values()) else ""


_ALL = 1e-9  # metal that is molten but for so much is liquid


def start_at(trajectory: Trajectory, time_s: float) -> Start:
    """State of the robot in a plan: place, metal, and what it holds."""
    problem, now = trajectory.problem, trajectory.at([time_s])
    x_m, y_m, phi_rad, *kappa_per_m = now.q[0].tolist()
    heating = transition_model(problem).heating(trajectory.transitions)
    temperatures, fractions, bodies = list[float](), list[float](), list[float]()
    for j, (solid, liquid) in enumerate(problem.segment_thresholds_C):
        metal, share = float(now.temperature_C[0, j]), float(now.melt_fraction[0, j])
        share = 0.0 if share < _ALL else 1.0 if share > 1 - _ALL else share
        if share < 1:
            metal = solid + share * (liquid - solid) if share else min(metal, solid)
        temperatures.append(metal if share < 1 else max(metal, liquid))
        fractions.append(share)
        body = heating[j].body_C(np.array([time_s]))
        bodies.append(temperatures[j] if body is None else float(body[0]))
    return Start(
        x_m=x_m,
        y_m=y_m,
        phi_rad=phi_rad,
        kappa_per_m=tuple(kappa_per_m),
        temperature_C=tuple(temperatures),
        melt_fraction=tuple(fractions),
        body_temperature_C=None if bodies == temperatures else tuple(bodies),
        holding=_held(trajectory, time_s),
    )


def objects_at(trajectory: Trajectory, time_s: float) -> tuple[Object, ...]:
    """Objects where the plan has them."""
    problem = trajectory.problem
    if not problem.objects:
        return ()
    poses = object_poses(trajectory, np.array([time_s]))[0].tolist()
    return tuple(
        item.with_values(pose=dict(zip(("x_m", "y_m", "phi_rad"), pose, strict=True)))
        for item, pose in zip(problem.objects, poses, strict=True)
    )


def _held(trajectory: Trajectory, time_s: float) -> str | None:
    """Name of the object in hand."""
    held = trajectory.problem.start.holding
    for task, done_s in zip(trajectory.problem.tasks, trajectory.done_s, strict=False):
        if done_s <= time_s:
            held = task.about if task.takes else None if task.lets_go else held
    return held
