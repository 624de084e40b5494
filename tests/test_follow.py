"""Paths that are followed: within the tolerance at every instant, and no quicker than is proved."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twosra_mpc import Follow, InputError, Problem, Status, load_problem, load_robot, plan
from twosra_mpc.checking.followed import followed, tube_problems
from twosra_mpc.checking.verification import verify
from twosra_mpc.contact.grip import Pulls
from twosra_mpc.execution.executor import Executor
from twosra_mpc.execution.guard import cage_of
from twosra_mpc.execution.robot_interface import Motors
from twosra_mpc.execution.run import Ending
from twosra_mpc.execution.settings import ExecutorSettings
from twosra_mpc.execution.simulation.disturbance import Disturbance
from twosra_mpc.execution.simulation.plant import SimulatedRobot
from twosra_mpc.execution.simulation.simulate import simulate
from twosra_mpc.model.flow import twists
from twosra_mpc.planning.stages.along import drives_along, easy_headings, late, least_time_s
from twosra_mpc.planning.stages.variants import turning
from twosra_mpc.plotting.run_figures import run_playback
from twosra_mpc.problem.speeds import drive_rows
from twosra_mpc.problem.tasks import Carry, part_in_b0, put
from twosra_mpc.problem.world import Object
from twosra_mpc.robot.coordinates import Array, composed

ROBOT = load_robot("2sra-v1")


def random_bezier(seed: int) -> list[list[float]]:
    """Control points of a curve from the origin ahead."""
    inner = np.random.default_rng(seed).uniform([0.2, -0.5], [1.2, 0.5], (3, 2))
    return [[0.0, 0.0], *inner.tolist()]


def from_points_m(points: Array, task: Follow) -> float:
    """Largest distance of points (m, 2) from all of a path, whatever its order [m]."""
    line = task.line
    fine = line.at(np.linspace(0.0, line.length_m[-1], 20_000))
    return max(float(np.hypot(*(fine - point).T).min()) for point in points)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("heading", ["free", "tangent", 0.0])
def test_a_drive_keeps_to_the_tube_and_the_limits_between_nodes(
    seed: int, heading: str | float
) -> None:
    part = "unit 1" if seed % 2 else "middle link"
    task = Follow(path={"bezier": random_bezier(seed)}, heading=heading, part=part)  # type: ignore[arg-type]
    kappa = np.array([10.0, -10.0])
    in_b0 = part_in_b0(ROBOT, kappa, part)
    line = task.line
    phi = line.headings[0] if heading == "tangent" else in_b0[2]
    b0 = composed(np.append(line.points[0], phi), composed(np.zeros(3), _back(in_b0)))
    q = np.append(b0, kappa)
    rows, wheels = drive_rows(ROBOT, kappa)
    most = ROBOT.limits.wheel_acceleration_rad_s2
    assert most is not None
    for found in drives_along(ROBOT, q, task, in_b0):
        times = found.motion.lasting_s[0]
        twist = np.vstack([np.zeros(3), found.twists[len(times) :] / times[:, None]])
        assert np.abs(twist @ rows.T).max() <= 1 + 1e-9
        assert np.abs(np.diff(twist, axis=0) @ wheels.T / times[:, None]).max() <= most * (1 + 1e-9)
        at = np.append(0.0, times.cumsum())

        def rate(t: float, pose: Array, at: Array = at, twist: Array = twist) -> Array:
            u, v, r = (np.interp(t, at, each) for each in twist.T)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            return np.array([c * u - s * v, s * u + c * v, r])

        asked = np.linspace(0.0, at[-1], 300)
        own = solve_ivp(rate, (0.0, at[-1]), q[:3], t_eval=asked, max_step=0.1, rtol=1e-8).y.T
        assert from_points_m(composed(own, in_b0)[:, :2], task) <= task.position_tolerance_m
        assert np.hypot(*(composed(own[-1], in_b0)[:2] - line.points[-1])) <= 1e-3
        assert at[-1] >= least_time_s(ROBOT, kappa, task, in_b0) > 0


def _back(pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]])


def test_the_plan_verifies_and_one_beside_the_path_does_not() -> None:
    problem = load_problem("follow-bezier")
    found = plan(problem).require()
    assert found.lower_bound is not None
    assert found.duration_s >= found.lower_bound
    (task,) = problem.tasks
    assert isinstance(task, Follow)
    beside = task.with_values(path=[(x, y + 0.03 * x) for x, y in task.path])
    moved = replace(found.trajectory, problem=problem.with_values(tasks=[beside]))
    assert any("off its path" in words for words in verify(moved).problems)


SQUARE = [[0, 0], [0.3, 0], [0.3, 0.3]]


@pytest.mark.parametrize(
    ("given", "field", "words"),
    [
        ({"path": SQUARE, "heading": "tangent"}, "path.1", "turns by 90 degrees at once"),
        ({"path": [[0, 0], [0, 0]]}, "path", "two different points"),
        ({"path": {"bezier": SQUARE}}, "path", "control points"),
        ({"path": [[0, 0, 0], [1, 0, 0]], "heading": "tangent"}, "heading", "left out"),
        ({"path": SQUARE, "from_m": 2.0}, "from_m", "less than"),
        ({"path": SQUARE, "times_s": [0.0, 9.0]}, "times_s", "one for each of 3 points"),
        ({"path": SQUARE, "times_s": [0.0, 9.0, 8.0]}, "times_s.2", "later than the one before"),
    ],
)
def test_what_nothing_can_follow_is_refused(given: Any, field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as refused:
        Follow(**given)
    assert refused.value.field.endswith(field)


@pytest.mark.parametrize("from_m", [0.0, 0.1])
def test_a_path_with_times_is_followed_in_time_or_refused(from_m: float) -> None:
    kappa, given = np.zeros(2), {"path": SQUARE, "from_m": from_m}
    task = Follow(**given, times_s=[50.0, 60.0, 80.0])  # type: ignore[arg-type]
    q = np.array([*task.left.points[0], 0.0, *kappa])
    for found in drives_along(ROBOT, q, task, np.zeros(3)):
        assert late(ROBOT, task, found, np.zeros(3)) is None
        assert found.lasts_s == pytest.approx(30.0 * (1 - from_m / 0.9), abs=1e-9)
        at_s = np.append(0.0, found.motion.lasting_s[0].cumsum())
        poses = found.motion.states[0, :, :3]
        assert not [*tube_problems(task, followed(task, at_s, poses))]
        hurried = task.with_values(times_s=[50.0, 55.0, 80.0])
        (words,) = tube_problems(hurried, followed(hurried, at_s, poses))
        assert ("ends before it is" if from_m else "mm from") + " where it is due" in words
        late_s = [followed(each, at_s, poses).late_s.max() for each in (task, hurried)]
        assert 0 == late_s[0] < late_s[1]
    hurried = task.with_values(times_s=[50.0, 60.0, 61.0])
    (found, *_) = drives_along(ROBOT, q, hurried, np.zeros(3))
    words, proved = late(ROBOT, hurried, found, np.zeros(3)) or ("", False)
    assert "it takes 5.69 s at least" in words
    assert proved


PUSH = [[0.0, 0.0345], [0.0, 0.4], [0.3, 0.4], [0.3, 0.8]]
TIGHT = [[0.0, 0.0345], [0.0, 0.06], [0.02, 0.06], [0.02, 0.0345]]
ASIDE = [[0.0, 0.0345], [0.3, 0.0345], [0.36, 0.0345], [0.5, 0.0]]


@pytest.mark.parametrize(
    ("path", "mass_kg", "words"),
    [
        *((PUSH, 0.1, ""), (TIGHT, 0.1, "of a radius of"), (ASIDE, 0.1, "aside")),
        (PUSH, 1.0, r"a wheel would pull with 1\.\d\d N, and it can with 0.53 N"),
    ],
)
def test_what_is_pushed_follows_what_friction_allows(path: Any, mass_kg: float, words: str) -> None:
    """And is let go at the end of its path."""
    physics = ROBOT.true_physics.with_values(object_mass_kg=mass_kg, ranges={})
    crate: Any = {"name": "crate", "box": {"x_m": [-0.03, 0.03], "y_m": [-0.03, 0.03]}}
    crate |= {"friction": 0.4, "pose": {"x_m": 0.0, "y_m": 0.0345}}  # half a millimetre away
    start: Any = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    tasks: Any = [{"do": "follow", "object": "crate", "path": {"bezier": path}}]
    tasks += [] if words else [{"do": "release", "object": "crate"}]
    start["holding"], robot = "crate", ROBOT.with_values(physics=physics)
    found = plan(Problem(robot=robot, start=start, tasks=tasks, objects=[crate], gap=0.5))
    if words:
        assert (found.status, found.plan) == (Status.FAILED, None)  # for other drives may do
        assert re.search(words, found.message)
    else:
        assert found.require().verification.ok


@pytest.mark.parametrize("off_mm", [4.7, 4.9, 200.0])
def test_a_path_that_begins_elsewhere_is_driven_to(off_mm: float) -> None:
    """Within the tolerance of 5 mm, but hardly, it is driven to as well."""
    start = {"x_m": 0.0, "y_m": off_mm / 1e3, "phi_rad": 0.094, "kappa_per_m": [0.0, 0.0]}
    tasks = [{"do": "follow", "path": SQUARE, "heading": 0.0}]
    made = plan(Problem(robot=ROBOT, start=start, tasks=tasks, gap=0.2)).require()  # type: ignore[arg-type]
    *way, _ = (task.do for task in made.problem.tasks)
    assert way == ([] if off_mm == 4.7 else ["reach"])
    assert made.verification.ok


def test_one_that_begins_elsewhere_than_the_task_before_ends_says_so() -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    reach = {"do": "reach", "x_m": 0.2, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    tasks = [reach, {"do": "follow", "path": SQUARE, "heading": 0.0}]
    found = plan(Problem(robot=ROBOT, start=start, tasks=tasks, gap=0.2))  # type: ignore[arg-type]
    assert found.plan is None
    assert 'a task "reach" before it: x_m = 0, y_m = 0, phi_rad = 0' in found.message


def test_an_object_is_led_no_nearer_than_its_cage_has_room() -> None:
    start = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": (39.0, 39.0), "holding": "cup"}
    cup = {"name": "cup", "pose": {"x_m": 0.0, "y_m": 0.0342}, "disc": {"radius_m": 0.0275}}
    task: Any = {"do": "follow", "object": "cup", "path": [[0.0, 0.0342], [0.3, 0.1]]}
    given: Any = {"robot": ROBOT, "start": start, "objects": [cup], "gap": 0.2}
    found = plan(Problem(**given, tasks=[task | {"position_tolerance_m": 0.003}]))
    assert found.status is Status.INFEASIBLE
    words = re.match(r"cup has ([\d.]+) mm of room in its cage: .* = 0.003 m", found.message)
    assert words is not None
    least_m = 1.01e-3 * float(words[1])
    assert least_m > 0.003
    made = plan(Problem(**given, tasks=[task | {"position_tolerance_m": least_m}])).require()
    assert made.verification.ok
    q = made.problem.start.configuration
    for deep_m in (0.0, 1e-3):  # as deep as it seems to be in the robot: there it is tight
        cage = cage_of(made.problem, q, 0, np.array([0.0, 0.0315 - deep_m, 0.0]))
        assert cage is not None
        assert cage.proved
    carry = Carry(object="cup", x_m=0.0, y_m=0.0)
    assert put([carry, *made.problem.tasks])["cup"].x_m == 0.3  # the path's end


@pytest.mark.parametrize("before", [{"tolerance": {"x_m": 0.02}}, {"x_m": None}, {"phi_rad": None}])
def test_a_path_begins_where_the_task_before_allows(before: dict[str, Any]) -> None:
    start = {"x_m": 0.2, "y_m": 0.1, "phi_rad": 0.3, "kappa_per_m": [0.0, 0.0]}
    box = {"do": "reach", "x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0} | before
    path = {"do": "follow", "path": [[0.015, 0.0], [0.3, 0.0]], "heading": "free"}
    tasks: Any = [box, path]
    problem = Problem(robot=ROBOT, start=start, tasks=tasks, gap=0.2)  # type: ignore[arg-type]
    if "phi_rad" in before:  # 15 mm beside it, where a heading is no help
        assert plan(problem).status is Status.FAILED
    else:
        assert plan(problem).require().verification.ok


def test_files_hold_the_same_path(tmp_path: Path) -> None:
    csv, svg = tmp_path / "path.csv", tmp_path / "path.svg"
    csv.write_text("x,y,t_s\n0,0,1\n0.3,0,2\n0.3,0.3,9\n")
    assert Follow(path=str(csv)).times_s == (1.0, 2.0, 9.0)  # type: ignore[arg-type]
    svg.write_text('<svg><path d="M0 0 h300 v-300"/></svg>')
    for name in (csv, svg):
        line = Follow(path=str(name)).line  # type: ignore[arg-type]
        assert line.length_m[-1] == pytest.approx(0.6)
        assert line.at(np.array([0.45])) == pytest.approx(np.array([[0.3, 0.15]]))
    for data, words in (
        ("h300 M500 0 h10", "from .300, 0. to .500, 0."),
        ("C 10 20 30", "6 numbers after"),
    ):
        svg.write_text(f'<svg><path d="M0 0 {data}"/></svg>')
        with pytest.raises(InputError, match=words):
            Follow(path=str(svg))  # type: ignore[arg-type]


def test_a_cusp_may_be_a_bend_of_the_radius_that_is_said() -> None:
    """Round its tip: what is refused as a cusp is taken once it turns there so."""
    line: Any = {"do": "follow", "heading": "tangent", "position_tolerance_m": 0.008}
    with pytest.raises(InputError, match=r"no cusp.* a bend of a radius up to 8 mm"):
        Follow(path=[(0.0, 0.0), (0.3, 0.0), (0.0, 1e-4)], **line)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 40)
    bend = 0.008 * np.column_stack([np.cos(angles), np.sin(angles)]) + [0.3, 0.0]
    Follow(path=[(0.0, -0.008), *map(tuple, bend.tolist()), (0.0, 0.008)], **line)


def test_a_run_that_is_pushed_aside_goes_back_and_follows_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wait, pushed = SimulatedRobot.wait, list[float]()

    def pushing(robot: SimulatedRobot, at_most_s: float) -> None:
        wait(robot, at_most_s)
        if robot.time_s > 12.0 and not pushed:
            pushed.append(robot.time_s)
            robot.push(np.array([0.08, 0.08, 0.1]))

    monkeypatch.setattr(SimulatedRobot, "wait", pushing)
    problem = load_problem("follow-bezier", motion="fastest")
    done = simulate(problem, plan=plan(problem).require())
    run, numbers = done.run, done.metrics
    assert run.ending is Ending.REACHED
    assert numbers.off_path_m is not None
    assert numbers.off_path_mean_m is not None
    assert 0.05 < numbers.off_path_m < 0.12  # pushed: no part of the way is left out
    assert 0.001 < numbers.off_path_mean_m < 0.02
    (drawn,) = run_playback(run, done.truth).off
    assert drawn.off_m.max() == numbers.off_path_m
    *_, task = run.plans[-1].problem.tasks
    assert isinstance(task, Follow)
    assert task.from_m > 0.3
    assert task.left.length_m[-1] == pytest.approx(task.line.length_m[-1] - task.from_m)


def test_motors_turn_as_their_lag_says_and_coast_by_it() -> None:
    told, period_s, lag_s = np.array([3.0, -1.0, 0.0, 5.0]), 1 / 15, 0.1
    motors, turned = Motors(lag_s), np.zeros(4)
    for _ in range(9):
        turned += motors.turned(told, period_s)
    own = solve_ivp(lambda _, w: (told - w) / lag_s, (0.0, 0.6), np.zeros(4), rtol=1e-10)
    assert motors.rad_s == pytest.approx(own.y[:, -1], abs=1e-6)
    assert turned == pytest.approx(0.6 * told - lag_s * own.y[:, -1], abs=1e-6)
    left = motors.lag_s * motors.rad_s
    assert sum(motors.turned(np.zeros(4), period_s) for _ in range(20)) == pytest.approx(
        left, abs=1e-3 * lag_s
    )


def past_the_end_m(known_lag_s: float) -> float:
    """How far a robot whose motors lag comes past the end of a straight path."""
    line = {"do": "follow", "path": [[0, 0], [0.1, 0]], "heading": 0.0}
    still = {"x_m": 0.0, "y_m": 0.0, "phi_rad": 0.0, "kappa_per_m": [0.0, 0.0]}
    made = plan(Problem(robot=ROBOT, start=still, tasks=[line], motion="fastest")).require()  # type: ignore[arg-type]
    robot = SimulatedRobot(made.problem, "as-planned", Disturbance(motor_lag_s=0.1))
    Executor(robot, ExecutorSettings(motor_lag_s=known_lag_s)).run(made)
    return float(robot.truth().q[:, 0].max()) - 0.1


def test_a_run_that_knows_the_lag_of_its_motors_stops_where_its_path_ends() -> None:
    assert past_the_end_m(0.1) < 5e-4 < 1e-3 < past_the_end_m(0.0)


@pytest.mark.parametrize("seed", range(3))
def test_an_object_is_turned_about_where_no_way_to_its_path_is_easy(seed: int) -> None:
    """It is where it is meanwhile, and on the way wheels pull next to least."""
    rng, kappa = np.random.default_rng(seed), np.array([38.0, 38.0])
    thing = Object(name="cup", pose={"x_m": 0.0, "y_m": 0.0}, disc={"radius_m": 0.03})  # type: ignore[arg-type]
    pulls = Pulls.of(ROBOT, kappa, thing, np.array([0.0, 0.0345, 0.7]))
    begin, end = rng.uniform(-0.3, 0.3, (2, 3)) * [1, 1, 10]
    via = turning(pulls, begin, end)
    at = composed(np.vstack([begin, via, end]), pulls.pose_in_b0)
    assert at[[0, 2], :2] == pytest.approx(at[[1, 3], :2], abs=1e-9)
    ahead = np.linspace(0, np.pi, 1000)
    ways = np.column_stack([np.cos(ahead), np.sin(ahead), 0 * ahead])
    assert pulls(twists(via[:1], via[1:]))[0] <= 1.2 * pulls(ways).min()


def test_paths_are_begun_at_headings_in_which_wheels_pull_as_little_as_at_any() -> None:
    kappa, in_b0 = np.array([38.0, 38.0]), np.array([0.0, 0.0345, 0.0])
    thing = Object(name="cup", pose={"x_m": 0.0, "y_m": 0.0}, disc={"radius_m": 0.03})  # type: ignore[arg-type]
    pulls = Pulls.of(ROBOT, kappa, thing, in_b0)
    task = Follow(path={"bezier": random_bezier(1)})  # type: ignore[arg-type]

    def led(heading: float) -> list[float]:
        at = composed(np.append(task.line.points[0], heading), composed(np.zeros(3), _back(in_b0)))
        found = drives_along(ROBOT, np.append(at, kappa), task, in_b0)
        return [float(pulls(each.twists).max()) for each in found]

    easy = min(min(led(heading)) for heading in easy_headings(task.left, pulls).tolist())
    assert easy <= 1.05 * min(min(led(heading)) for heading in np.arange(0.0, np.pi, 0.4))
