"""The published greedy planner reproduces the published simulations, and always stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from twosra_mpc.errors import InputError
from twosra_mpc.lab.reproduction.published_model import published_jacobian
from twosra_mpc.lab.reproduction.published_runs import (
    PublishedTrajectory,
    StopReason,
    published_trajectory,
)
from twosra_mpc.robot.modes import MODES, Mode

Q = tuple[float, float, float, float, float]
FloatArray = NDArray[np.float64]

ROUNDING = 1e-12  # published rows are reproduced to about 1e-14; m, rad or 1/m
GAIN_LIMIT_ITERATION = 799  # first iteration (from 0) with t DT = (i + 1) DT^2 >= 2 at DT = 0.05


@dataclass(frozen=True)
class Simulation:
    """One published simulation.

    Attributes:
        switches: iterations at which the mode changes.
        modes: recorded mode sequence.
        recorded: number of recorded rows.
        rows: some of them; number, x, y, phi, kappa1, kappa2, s1, s2.
    """

    number: int
    start: Q
    goal: Q
    switches: tuple[int, ...]
    modes: tuple[Mode, ...]
    recorded: int
    step_s: float = 0.05
    rows: str = ""

    def run(self, *, forced: bool) -> PublishedTrajectory:
        """Run the planner, at ``forced`` with the mode switches where they were published.

        The stagnation test that decides a switch compares with the last bit of q: without forced
        switches another exp, sin or cos in the C library may shift simulations 3 and 4.
        """
        switches = self.switches if forced else None
        return published_trajectory(
            self.start, self.goal, step_s=self.step_s, switch_iterations=switches
        )


# Source of start, goal and rows: the authors' simulated trajectories, simulation1-3.csv and
# simulation5.csv of their public repository 2sr-agent-simulation, published with Labazanova et
# al., IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749.
# Of simulation 4 only start, goal, switches and the number of rows are used.
SIMULATIONS = (
    Simulation(
        number=1,
        start=(0.26, 0.23, -0.3, 28.0, -16.0),
        goal=(0.24, 0.21, 0.5, 28.0, 3.0),
        switches=(163,),
        modes=((0, 1), (0, 0)),
        recorded=111,
        rows="""
0 0.26 0.23 -0.3 28.0 -16.0 0 0
1 0.259998608310718 0.22999690482740726 -0.2999024647499515 28.0 -15.997683397663783 0 1
50 0.24280967447531654 0.20977090640819732 0.43870680791882544 28.0 1.5444767118857863 0 1
102 0.24086469688780102 0.20855215188259815 0.4999989670812312 28.0 2.9999702348088007 0 1
103 0.24051024478360983 0.20914559250012485 0.500000130563708 28.0 2.9999999999999996 0 0
104 0.24029982379901987 0.20949794351504916 0.5000000767202492 28.0 2.9999999999999996 0 0
110 0.2400112760785738 0.20998111814875497 0.5000000028853733 28.0 2.9999999999999996 0 0
""",
    ),
    Simulation(
        number=2,
        start=(0.29, 0.2, -0.62, -27.0, 15.0),
        goal=(0.27, 0.24, 0.9, 30.0, 15.0),
        switches=(162,),
        modes=((1, 0), (0, 0)),
        recorded=115,
        rows="""
0 0.29 0.2 -0.62 -27.0 15.0 0 0
1 0.2900024762287817 0.20000552446071837 -0.6198147568182151 -26.99305019299135 15.0 1 0
50 0.27212388046484864 0.2401969077120423 0.7834543210886658 25.63343013565736 15.0 1 0
105 0.2684166080159958 0.24097683485032179 0.8999445759285097 29.999963604801973 15.0 1 0
106 0.2690616356159365 0.24057889196052248 0.8999677304499324 29.999999999999996 15.0 0 0
107 0.26944625934610006 0.24034161144455313 0.8999809573316518 29.999999999999996 15.0 0 0
114 0.2699877626909212 0.24000754939122207 0.8999995791693881 29.999999999999996 15.0 0 0
""",
    ),
    Simulation(
        number=3,
        start=(0.231, 0.2, 0.44, -11.0, -13.0),
        goal=(0.225, 0.245, -0.235, 38.0, 34.0),
        switches=(166, 216, 253),
        modes=((1, 1), (0, 1), (1, 0), (0, 0)),
        recorded=144,
        rows="""
0 0.231 0.2 0.44 -11.0 -13.0 0 0
1 0.23099676246716244 0.20000765162915884 0.4399176958182967 -10.994219352959728 -12.994080265374588 1 1
20 0.22590831532894215 0.21438303524629496 0.2883736305754109 -0.34326642379227 -2.10164202014691 1 1
106 0.22832998899864854 0.24398867942843777 -0.23492045040763615 37.31556032005313 34.70595953690703 1 1
107 0.22832990682634846 0.24398864762096775 -0.23491761817717 37.31558329220972 34.4113040800363 0 1
124 0.22832981385343956 0.24398861217979914 -0.2349144381905116 37.31558329220972 34.000021502253304 0 1
125 0.2283300091053883 0.2439887287201391 -0.23492184090789364 37.686872151331414 34.0 1 0
137 0.22833022767045666 0.24398886413050103 -0.23493023658332415 37.999982977058764 34.0 1 0
138 0.2262155395639695 0.2446309334561737 -0.23497453668329996 38.0 34.0 0 0
143 0.2250070966501493 0.24499784528926824 -0.23499985133824053 38.0 34.0 0 0
""",  # noqa: E501 (a published row stays on one line)
    ),
    Simulation(
        number=4,
        start=(0.238, 0.276, -0.24, -38.0, -24.0),
        goal=(0.24, 0.3, -0.15, -15.0, -5.0),
        switches=(162, 216, 254),
        modes=((1, 1), (0, 1), (1, 0), (0, 0)),
        recorded=140,
    ),
    Simulation(
        number=5,
        start=(0.231, 0.262, -0.34, -27.0, -16.0),
        goal=(0.241, 0.266, -0.5, -25.0, 12.0),
        switches=(74, 93),
        modes=((0, 1), (1, 0), (0, 0)),
        recorded=62,
        step_s=0.1,
        rows="""
0 0.231 0.262 -0.34 -27.0 -16.0 0 0
1 0.23100236528917434 0.2620047436111675 -0.3401523419788004 -27.0 -15.97335447705007 0 1
25 0.23505943050660294 0.26543226661903613 -0.4899284788868906 -27.0 10.206157562808142 0 1
50 0.23541632376030389 0.2655186612745179 -0.5001978527700605 -27.0 11.999985953612867 0 1
51 0.23541715146100517 0.2655244575321339 -0.5000188080428307 -25.500829626555223 12.0 1 0
58 0.23541729250964927 0.2655260414869883 -0.4999705945569876 -25.00000882257863 12.0 1 0
59 0.2406646034356946 0.2659715256328479 -0.4999982334190661 -25.0 12.0 0 0
61 0.2409993271609616 0.26599994287757284 -0.499999996456062 -25.0 12.0 0 0
""",
    ),
)
SIMULATION_1 = SIMULATIONS[0]

each_simulation = pytest.mark.parametrize(
    "simulation", SIMULATIONS, ids=lambda simulation: f"simulation{simulation.number}"
)
each_soft_mode = pytest.mark.parametrize("mode", MODES[1:], ids=lambda mode: f"{mode[0]}{mode[1]}")


def mode_changes(trajectory: PublishedTrajectory) -> list[int]:
    """Return the rows at which the recorded mode differs from the row before; row 1 is first."""
    changed = np.any(np.diff(trajectory.mode[1:], axis=0) != 0, axis=1)
    return [1, *(int(row) + 2 for row in np.flatnonzero(changed))]


def mode_sequence(trajectory: PublishedTrajectory) -> tuple[Mode, ...]:
    """Return the recorded modes without repetitions, leaving out the start row."""
    modes = trajectory.mode.tolist()
    return tuple((modes[row][0], modes[row][1]) for row in mode_changes(trajectory))


def random_configuration(rng: np.random.Generator) -> FloatArray:
    """Draw x, y within 0.25 m, any heading, and curvatures within +-78 1/m (a half circle)."""
    bound = np.array([0.25, 0.25, np.pi, 78.0, 78.0])
    return rng.uniform(-bound, bound)


@each_simulation
def test_published_rows_are_reproduced_to_rounding(simulation: Simulation) -> None:
    trajectory = simulation.run(forced=True)
    assert len(trajectory.q) == simulation.recorded
    for line in simulation.rows.split("\n")[1:-1]:
        row, *q, s1, s2 = (float(word) for word in line.split())
        np.testing.assert_allclose(trajectory.q[int(row)], q, rtol=0.0, atol=ROUNDING)
        assert trajectory.mode[int(row)].tolist() == [s1, s2]


@each_simulation
def test_forced_switches_give_the_published_mode_sequence(simulation: Simulation) -> None:
    trajectory = simulation.run(forced=True)
    assert mode_sequence(trajectory) == simulation.modes
    first_iterations = trajectory.iteration[mode_changes(trajectory)].tolist()
    assert first_iterations == [0, *simulation.switches]


@each_simulation
def test_every_simulation_reaches_its_target(simulation: Simulation) -> None:
    trajectory = simulation.run(forced=True)
    assert trajectory.stop is StopReason.REACHED
    np.testing.assert_allclose(trajectory.final_q, simulation.goal, rtol=0.0, atol=1e-9)


@each_simulation
def test_the_stagnation_rule_finds_the_same_modes_unforced(simulation: Simulation) -> None:
    trajectory = simulation.run(forced=False)
    assert trajectory.stop is StopReason.REACHED
    assert mode_sequence(trajectory) == simulation.modes
    # A switch one bit earlier or later shifts the schedule, which can move a row or two across
    # the threshold for recording.
    assert abs(len(trajectory.q) - simulation.recorded) <= 2


@each_simulation
def test_every_recorded_step_is_the_published_formula(simulation: Simulation) -> None:
    trajectory = simulation.run(forced=True)
    goal = np.array(simulation.goal)
    consecutive = np.flatnonzero(np.diff(trajectory.iteration) == 1)
    assert len(consecutive) > 50
    for row in consecutive:
        s1, s2 = trajectory.mode[row + 1].tolist()
        jacobian = published_jacobian(trajectory.q[row], simulation.start, (s1, s2))
        time_s = simulation.step_s * (int(trajectory.iteration[row + 1]) + 1)
        velocity = np.linalg.pinv(jacobian) @ ((goal - trajectory.q[row]) * time_s)
        step = (1.0 - np.exp(-time_s)) * (jacobian @ velocity) * simulation.step_s
        np.testing.assert_allclose(trajectory.velocity[row + 1], velocity, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(
            trajectory.q[row + 1], trajectory.q[row] + step, rtol=0.0, atol=1e-9
        )


def test_row_0_is_the_start_at_rest_in_the_rigid_mode() -> None:
    trajectory = SIMULATION_1.run(forced=True)
    assert trajectory.q[0].tolist() == list(SIMULATION_1.start)
    assert trajectory.mode[0].tolist() == [0, 0]
    assert trajectory.velocity[0].tolist() == [0.0] * 5
    assert trajectory.iteration[0] == -1


def test_arrays_are_read_only() -> None:
    trajectory = SIMULATION_1.run(forced=True)
    for array in (trajectory.q, trajectory.mode, trajectory.velocity, trajectory.iteration):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_start_at_the_goal_is_reached_without_a_step() -> None:
    trajectory = published_trajectory(SIMULATION_1.start, SIMULATION_1.start)
    assert trajectory.stop is StopReason.REACHED
    assert trajectory.iterations == 0
    assert len(trajectory.q) == 1


# --- stopping -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_a_straight_robot_at_the_origin_cannot_be_reached(seed: int) -> None:
    """At 0 floats have no last bit to stop on, and the growing gain blows the residual up."""
    start = random_configuration(np.random.default_rng(seed))
    trajectory = published_trajectory(start, np.zeros(5))
    assert trajectory.stop is StopReason.DIVERGED
    assert trajectory.iterations > GAIN_LIMIT_ITERATION
    assert np.all(np.isfinite(trajectory.q))


def test_a_residual_left_when_the_gain_passes_2_diverges() -> None:
    trajectory = published_trajectory(
        SIMULATION_1.start, SIMULATION_1.goal, switch_iterations=(GAIN_LIMIT_ITERATION,)
    )
    assert trajectory.stop is StopReason.DIVERGED
    assert GAIN_LIMIT_ITERATION < trajectory.iterations < 1200


@each_simulation
def test_a_coarse_time_step_diverges_at_once(simulation: Simulation) -> None:
    trajectory = published_trajectory(simulation.start, simulation.goal, step_s=0.5)
    assert trajectory.stop is StopReason.DIVERGED
    assert trajectory.iterations < 50


def test_the_rare_generic_problem_that_diverges_stops() -> None:
    """Seed 318 of 0 to 5999 is the one generic problem that diverged (at iteration 1093).

    Which generic problem does depends on the last bits, hence on the C library; elsewhere this
    one may be reached. It must end in one of the two ways, and not before the gain passed 2 if it
    diverges.
    """
    rng = np.random.default_rng(318)
    trajectory = published_trajectory(random_configuration(rng), random_configuration(rng))
    assert trajectory.stop in (StopReason.REACHED, StopReason.DIVERGED)
    assert (trajectory.iterations > GAIN_LIMIT_ITERATION) == (
        trajectory.stop is StopReason.DIVERGED
    )


def test_generic_problems_are_reached_with_at_most_four_recorded_phases() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        start, goal = random_configuration(rng), random_configuration(rng)
        trajectory = published_trajectory(start, goal)
        assert trajectory.stop is StopReason.REACHED
        assert len(mode_sequence(trajectory)) in (3, 4)


def test_iteration_limit_is_reported_with_the_configuration_so_far() -> None:
    whole = SIMULATION_1.run(forced=True)
    trajectory = published_trajectory(SIMULATION_1.start, SIMULATION_1.goal, max_iterations=30)
    assert trajectory.stop is StopReason.ITERATION_LIMIT
    assert "max_iterations" in trajectory.stop.value
    assert trajectory.iterations == 30
    np.testing.assert_allclose(trajectory.q, whole.q[:31], rtol=0.0, atol=ROUNDING)
    assert trajectory.final_q.tolist() == trajectory.q[-1].tolist()


# --- Jacobian -------------------------------------------------------------------------------


@each_soft_mode
def test_soft_columns_follow_the_start_of_the_plan_not_the_present_pose(mode: Mode) -> None:
    rng = np.random.default_rng(3)
    q, q_start = random_configuration(rng), random_configuration(rng)
    moved = q + np.array([0.1, -0.1, 0.7, 0.0, 0.0])
    turned = q_start + np.array([0.0, 0.0, 0.7, 0.0, 0.0])
    jacobian = published_jacobian(q, q_start, mode)
    np.testing.assert_array_equal(published_jacobian(moved, q_start, mode), jacobian)
    rotation = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    np.testing.assert_allclose(
        published_jacobian(q, turned, mode)[:2], rotation @ jacobian[:2], atol=1e-12
    )


# --- bad input ------------------------------------------------------------------------------


@pytest.mark.parametrize("field", ["start", "goal"])
@pytest.mark.parametrize(
    ("configuration", "allowed"),
    [
        ((0.0, 0.0, 0.0), "five numbers"),
        ((0.0, 0.0, np.nan, 0.0, 0.0), "finite numbers"),
        ((0.0, 0.0, 0.0, 158.0, 0.0), r"curvatures within .*157\.1 1/m"),
    ],
)
def test_a_bad_configuration_is_named(
    field: str, configuration: tuple[float, ...], allowed: str
) -> None:
    arguments = {"start": SIMULATION_1.start, "goal": SIMULATION_1.goal, field: configuration}
    with pytest.raises(InputError, match=allowed) as raised:
        published_trajectory(arguments["start"], arguments["goal"])
    assert raised.value.field == field
    np.testing.assert_equal(raised.value.value, list(configuration))


@pytest.mark.parametrize("step_s", [0.0, -0.05, np.inf, np.nan])
def test_a_bad_time_step_is_rejected(step_s: float) -> None:
    with pytest.raises(InputError, match="allowed: a finite number, more than 0") as raised:
        published_trajectory(SIMULATION_1.start, SIMULATION_1.goal, step_s=step_s)
    assert raised.value.field == "step_s"


@pytest.mark.parametrize("field", ["q", "q_start"])
def test_a_bad_configuration_of_the_jacobian_is_named(field: str) -> None:
    arguments = {"q": SIMULATION_1.start, "q_start": SIMULATION_1.start, field: (0.0, 0.0)}
    with pytest.raises(InputError, match="five numbers") as raised:
        published_jacobian(arguments["q"], arguments["q_start"], (1, 0))
    assert raised.value.field == field


def test_an_unknown_mode_is_rejected() -> None:
    with pytest.raises(InputError, match=r"allowed: one of .*\(1, 1\)") as raised:
        published_jacobian(SIMULATION_1.start, SIMULATION_1.start, (2, 0))
    assert raised.value.field == "mode"
    assert raised.value.value == (2, 0)
