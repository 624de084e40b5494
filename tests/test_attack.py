"""Plans made without the planner: they are plans, and none costs less than what is proved."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.__main__ import main
from benchmarks.attack.attacks import Attack, attack, attack_of, bodies
from benchmarks.attack.heat import Item
from benchmarks.attack.kinematics import Reference
from benchmarks.attack.motion import Phase, random_phase
from benchmarks.attack.trial import claims, planned
from benchmarks.studies import forgery
from twosra_mpc import Goal, Problem, Robot, Start
from twosra_mpc.checking.levers import bend_levers
from twosra_mpc.model.flow import roll_out
from twosra_mpc.model.kinematics import kinematics
from twosra_mpc.planning.search.nodes import Node
from twosra_mpc.planning.search.tree import Tree
from twosra_mpc.planning.solver.fixed_sequence import Candidate, verified
from twosra_mpc.plans.speed_profile import fastest
from twosra_mpc.problem.limits import shape_margins
from twosra_mpc.problem.tolerances import forgiven
from twosra_mpc.robot.coordinates import INPUTS, POSE
from twosra_mpc.robot.modes import RIGID, SOFT_1, SOFT_BOTH, ModeSequence, is_rigid
from twosra_mpc.robot.timing import OverlappedTiming
from twosra_mpc.timing import Transition, transition_model
from twosra_mpc.timing.thermal import Thermal

MANY = range(9)  # of more: python -m benchmarks attack

attacked = cache(attack)


@pytest.mark.parametrize("name", bodies())
def test_the_attackers_kinematics_is_that_of_the_model(name: str) -> None:
    robot, rng = bodies()[name], np.random.default_rng(0)
    reference, compiled = Reference(robot), kinematics(robot)
    for _ in range(10):
        kappa = rng.uniform(-1, 1, robot.coordinates.segments) * robot.limits.curvature_per_m
        q = np.concatenate([rng.uniform(-1, 1, POSE), kappa])
        margins = shape_margins(robot, kappa)
        room = reference.room_m(kappa) - robot.limits.unit_gap_m
        assert room == pytest.approx(margins["unit_gap_m"][0], abs=1e-9)
        assert reference.steady(kappa) == (margins["wheel_independence"][0] >= 0)
        for j in range(len(kappa)):
            levers = bend_levers(robot, kappa[None], j)
            assert reference.lever(kappa, j) == pytest.approx(levers[0], abs=1e-9)
        for mode in robot.modes:
            jacobian, wheels = (
                f(q, mode).full() for f in (compiled.jacobian, compiled.wheel_matrix)
            )
            if is_rigid(mode):
                np.testing.assert_allclose(reference.rigid(kappa), wheels[:, 2:], atol=1e-9)
                continue
            for unit in (0, 1):
                moved, turned = reference.soft(q, mode, unit)
                np.testing.assert_allclose(moved, jacobian[:, unit], atol=1e-9, rtol=1e-9)
                np.testing.assert_allclose(turned, wheels[:, unit], atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("seed", MANY)
def test_the_attackers_melts_and_freezes_are_those_of_the_timing(seed: int) -> None:
    made = attacked(seed)
    model, finish = transition_model(made.problem), made.timeline.finish_s
    items = sorted(Transition(i.segment + 1, *i[1:]) for i in made.timeline.items)
    items.sort(key=lambda item: item.heater_s)
    if made.problem.heating == "keep_warm":
        return  # the package keeps warm where that pays, the attacker at random
    energy = 0.0
    if isinstance(model, Thermal):
        for j, (plan, temperature) in enumerate(
            zip(model.plans, made.problem.start_states, strict=True)
        ):
            own = [item for item in items if item.segment == j + 1]
            onsets = [(item.to, item.onset_s) for item in own]
            trajectory, theirs = plan.heated(temperature, bool(model.first[j]), onsets)
            energy += trajectory.energy_J(finish)
            for mine, other in zip(own, theirs, strict=True):
                assert mine[3:] == pytest.approx(other[2:], abs=1e-6)
    else:
        before: dict[int, Transition] = {}
        for item in items:
            assert not list(model.violations(item, before.get(item.segment), items))
            before[item.segment] = item
        energy = sum(heating.energy_J(finish) for heating in model.heating(items))
    assert made.timeline.energy_J == pytest.approx(energy, rel=1e-6, abs=1e-6)


def as_plan(made: Attack, intervals: int = 12) -> tuple[float, float]:
    """(cost, claimed cost) of an attack as a verified plan, no phase quicker than the package's."""
    problem, layers = made.problem, []
    for phase in made.phases:
        pieces = max(1, len(phase.moves))
        share = np.repeat(phase.moves or [np.zeros(INPUTS)], intervals // pieces, axis=0)
        layers.append(share * pieces / intervals)
    inputs = np.array(layers)
    motion = roll_out(problem.robot, problem.start.configuration, made.sequence, inputs)
    np.testing.assert_allclose(motion.states[:, -1], [p.end for p in made.phases], atol=2e-7)
    profiles, phases = [], []
    for profile, phase in zip(fastest(motion), made.phases, strict=True):
        within = 0.02 if is_rigid(phase.mode) else 0.006  # of a circle, a 16-gon is used
        assert phase.duration_s >= profile.duration_s * (1 - within)
        lasting = max(phase.duration_s, profile.duration_s)
        profiles.append(profile.lasting(lasting))
        phases.append(phase.slower(lasting / phase.duration_s) if lasting else phase)
    slower = attack_of(problem, tuple(phases), np.random.default_rng(0), made.features)
    assert slower is not None
    sequence = made.sequence
    network = transition_model(problem).network(sequence, problem.goal.mode, [0.0] * len(sequence))
    layout, times = network.layout, np.zeros(network.layout.count)
    for i, start in enumerate(slower.timeline.starts_s):
        times[[layout.start(i), layout.end(i)]] = start, start + phases[i].duration_s
    onsets = {(item.segment, item.to, n): item.onset_s for n, item in numbered(slower)}
    for event in network.events:
        times[layout.onset_of(event)] = onsets[event.segment, event.to, event.number]
    times[layout.finish] = slower.timeline.finish_s
    plan = verified(problem, Candidate(motion, tuple(profiles), times, network, 0), network)
    assert plan.verification.ok, plan.verification.problems
    return plan.cost.total, slower.cost


def numbered(made: Attack) -> list[tuple[int, Item]]:
    """Transitions with how many of their segment come before."""
    seen: dict[int, int] = {}
    found = []
    for item in sorted(made.timeline.items, key=lambda item: item.onset_s):
        found.append((seen.get(item.segment, 0), item))
        seen[item.segment] = seen.get(item.segment, 0) + 1
    return found


@pytest.mark.parametrize("seed", [s for s in MANY if s % 3 == 0])
def test_attacks_are_plans_that_the_package_verifies(seed: int) -> None:
    made = attacked(seed)
    if made.problem.heating == "keep_warm":
        return
    cost, claimed = as_plan(made)
    assert cost == pytest.approx(claimed, rel=1e-4)


@pytest.mark.parametrize("seed", MANY)
def test_no_attack_costs_less_than_what_is_proved_of_it(seed: int) -> None:
    made = attacked(seed)
    for claim in claims(made, tighter=seed % 3 == 0):
        assert made.bears(claim.bound), claim


@pytest.mark.parametrize("seed", [3, 9, 12])
def test_a_search_proves_no_more_than_an_attack_costs(seed: int) -> None:
    made = attacked(seed)
    status, claim = planned(made, work_limit=2000.0)
    assert status in ("optimal", "feasible", "failed")
    assert made.bears(claim.bound), claim


def test_the_study_says_how_to_repeat_what_breaks_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = ["attack", "--out", str(tmp_path), "--set", "first=3", "--set", "count=2"]
    true = Tree.leaf_bound

    def too_high(tree: Tree[None], node: Node) -> float:
        return 10 * true(tree, node)

    monkeypatch.setattr(Tree, "leaf_bound", too_high)
    told = CliRunner().invoke(main, given).output
    assert "| all | 2 | 2 | 0 |" in told
    assert "`--set first=3 --set count=1`" in told
    monkeypatch.undo()
    repeated = CliRunner().invoke(main, [*given[:2], str(tmp_path / "again"), *given[3:]]).output
    assert "| all | 2 | 0 | 0 |" in repeated
    assert "`--set first=" not in repeated


# --- what once broke a bound ---------------------------------------------------------------------

STRAIGHT: dict[str, Any] = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (0.0, 0.0)}


def along(sequence: ModeSequence, robot: Robot, warm_C: float = 25.0, **given: Any) -> Attack:
    """An attack with these modes from a straight shape; where it ends is an exact goal."""
    reference, start = Reference(robot), Start(**STRAIGHT, temperature_C=(warm_C, warm_C))
    rng, q, phases = np.random.default_rng(3), start.configuration, []
    for mode in sequence:
        moved = random_phase(reference, q, mode, rng, far=0.1) if any(mode) else Phase(mode, q)
        phases.append(moved)
        q = moved.end
    x, y, phi, *kappa = q.tolist()
    goal = Goal(x_m=x, y_m=y, phi_rad=phi, kappa_per_m=tuple(kappa), tolerance="exact")
    asked = {"robot": robot, "start": start, "goal": goal, "motion": "fastest", **given}
    made = attack_of(Problem(**asked), tuple(phases), rng, ())
    assert made is not None
    return made


def test_metal_that_coasts_lets_one_heater_melt_the_other_segment() -> None:
    times = {"melt_s": 12.0, "melt_changing_s": 8.0, "superheat_s": 1.0}
    times |= {"freeze_s": 70.0, "freeze_changing_s": 50.0}  # coasts for 20 s
    timing = {"nominal": OverlappedTiming(overlap="full", **times)}
    robot = bodies()["arc"].with_values(timing=timing)
    made = along((RIGID, SOFT_1, SOFT_BOTH, RIGID), robot, heaters_at_once=1)
    on = {item.segment: item.heater_s for item in made.timeline.items if item.to == "soft"}
    off = {item.segment: item.heater_s for item in made.timeline.items if item.to == "rigid"}
    assert off[0] <= on[1]
    for claim in claims(made, tighter=False):
        assert made.bears(claim.bound), claim


@pytest.mark.parametrize("warm_C", [30.0, 50.0])
@pytest.mark.parametrize("cycles", [1, 2])
def test_windows_of_a_weak_heater_in_cold_air_forbid_nothing(warm_C: float, cycles: int) -> None:
    robot = bodies()["cardioid"]
    segment, key = robot.segment, "power_K_per_s"
    ranges = {**segment.ranges, key: tuple(0.45 * each for each in segment.ranges[key])}
    weak = segment.with_values(power_K_per_s=0.45 * segment.power_K_per_s, ranges=ranges)
    robot = robot.with_values(segment=weak)
    sequence = (RIGID, *(SOFT_1, RIGID) * cycles)
    made = along(sequence, robot, warm_C, ambient_C=5.0, transition_quantile=0.6)
    for claim in claims(made, tighter=False):
        assert made.bears(claim.bound), claim


@pytest.mark.parametrize("seed", [187, 227])
def test_reconfiguring_may_take_less_than_melting_from_cold(seed: int) -> None:
    made = attack(seed, "paper")
    for claim in claims(made, tighter=False):
        assert made.bears(claim.bound), claim


@pytest.mark.parametrize("seed", [59, 100, 116])
def test_what_verification_accepts_is_not_proved_impossible(seed: int) -> None:
    made = attacked(seed)
    assert "within the tolerance" in made.features
    for claim in claims(made, tighter=False):
        assert made.bears(claim.bound), claim


@pytest.mark.parametrize("name", ["dear energy", "paper-3, paper's robot"])
def test_no_forged_file_is_verified_below_what_is_proved(name: str, tmp_path: Path) -> None:
    """Nor does one save more than is taken off every bound for what verification forgives."""
    result = forgery.planned(name)
    cost = result.require().cost.total
    found = [forgery.tried(result, seed, tmp_path) for seed in range(8)]
    assert max(each.below_s for each in found) <= 0
    saved = [each.saved_s for each in found if each.verified]
    assert len(saved) > 2  # what changes nothing, or less than is forgiven
    assert max(saved) <= cost - forgiven(cost)
