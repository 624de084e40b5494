r"""A robot moved by MuJoCo: wheels roll, the fibre bends where metal is liquid, things collide.

Bending moments of a segment are those of two springs in parallel: rubber, straight at rest, and
metal by a power p of its solid share s, at rest in the shape in which it froze. Metal that freezes
at an angle adds to the mean of the rest angles by its share, metal that melts leaves it alone:

.. math:: M = -k_r \theta - s^p k_m (\theta - \theta_0), \qquad
    \theta_0 \leftarrow (s\,\theta_0 + \Delta s\,\theta) / (s + \Delta s).

Nobody has measured how metal sets: p is drawn from a range.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twosra_mpc.errors import InputError, RobotError
from twosra_mpc.installation import require
from twosra_mpc.physics import mjcf
from twosra_mpc.problem.problem import Problem
from twosra_mpc.robot.coordinates import POSE, WHEELS, Array
from twosra_mpc.robot.description import Robot
from twosra_mpc.robot.physics import Physics

_SETTLING_S = 0.1  # after the robot is put down
_AT_REST = 1e-4  # m/s and rad/s of b0, rad/s of hinges
_CHANGE = 0.01  # of a solid share: what rests is looked at again
_BAD = ("BADQPOS", "BADQVEL", "BADQACC")  # MuJoCo's words for what is not finite, or huge
_POSE_JOINTS = ("x", "y", "phi")


class Engine:
    """A robot among obstacles and objects.

    Attributes:
        physics: Its masses, stiffness and friction.
        model: MuJoCo's model.
        data: MuJoCo's state.
        touched: The obstacle that the robot touched first, by the engine's contacts after each
            motion; empty if none.
    """

    squeezed = ""  # things that overlap push each other away

    def __init__(
        self, problem: Problem, robot: Robot, physics: Physics, melted: Sequence[float]
    ) -> None:
        """Put the robot where the problem starts.

        Args:
            problem: Start, obstacles and objects.
            robot: The robot with its true lengths.
            physics: Masses, stiffness and friction.
            melted: Melt fraction of each segment.

        Raises:
            InputError: If MuJoCo is not installed, or the wheels cannot carry the robot.
            RobotError: If the start cannot be simulated.
        """
        require("plant mujoco", "physics", "mujoco")
        import mujoco  # type: ignore[import-untyped]

        mujoco.set_mju_user_warning(lambda text: None)  # else it writes a log file; see `roll`
        self._mujoco, self.physics = mujoco, physics
        text = mjcf.mjcf(robot, physics, problem=problem)
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self._lengths_m, self._hinges = np.array(robot.geometry.lengths_m), mjcf.HINGES
        count = robot.geometry.segments
        names = [f"bend{j + 1}_{k + 1}" for j in range(count) for k in range(mjcf.HINGES)]
        self._bends = self._addresses(names).reshape(count, mjcf.HINGES)
        self._wheels = self._addresses([f"wheel{number + 1}" for number in range(WHEELS)])
        self._pose = self._addresses(_POSE_JOINTS)
        self._objects = np.array(
            [self._addresses([f"{item.name}.{name}" for name in _POSE_JOINTS])
             for item in problem.objects], dtype=int,
        ).reshape(-1, POSE)  # fmt: skip
        self._object_start = np.array([item.pose.pose for item in problem.objects])
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self._rest_rad = self.data.qpos[self._bends].copy()
        self._solid = 1.0 - np.asarray(melted)
        self._stiffen()
        self._viewer: Any = None
        names = [self.model.body(number).name for number in range(self.model.nbody)]
        walls = [n for n, name in enumerate(names) if name.startswith(mjcf.WALL)]
        self._walls = {n: names[n].removeprefix(mjcf.WALL) for n in walls}
        self._things = {self.model.body(item.name).id for item in problem.objects}
        self.touched = ""
        self.roll(np.zeros(WHEELS), melted, _SETTLING_S)

    @property
    def q(self) -> Array:
        """Configuration [m, m, rad, 1/m ...], (3 + n,)."""
        bends = self.data.qpos[self._bends].sum(axis=1)
        return np.concatenate([self.data.qpos[self._pose], bends / self._lengths_m])

    @property
    def objects(self) -> Engine | None:
        """Objects with their ``poses``: this; None without any."""
        return self if self._objects.size else None

    @property
    def poses(self) -> Array:
        """Poses of the objects, (objects, 3) [m, m, rad]."""
        moved = self.data.qpos[self._objects]
        return moved + self._object_start.reshape(-1, POSE)

    def at_rest(self, melted: Sequence[float]) -> bool:
        """True if nothing would move if the wheels stood and metal were melted like this."""
        speeds = self.data.qvel[np.concatenate([self._pose, self._bends.ravel()])]
        changed = np.abs(1.0 - np.asarray(melted) - self._solid) >= _CHANGE
        return bool(np.abs(speeds).max() < _AT_REST) and not changed.any()

    def push(self, by: Array) -> None:
        """Shift and turn the robot about b0 by (3,) [m, m, rad], in no time."""
        self.data.qpos[self._pose] += by

    def roll(self, turned: Array, melted: Sequence[float], duration_s: float) -> None:
        """Turn the wheels by ``turned`` (4,) [rad] evenly in a time.

        Raises:
            RobotError: If the state is not finite any more, or the engine says so.
        """
        self._freeze(1.0 - np.asarray(melted))
        steps = max(1, round(duration_s / mjcf.STEP_S))
        self.model.opt.timestep = duration_s / steps
        self.data.ctrl[:] = turned / duration_s
        began_s = time.monotonic()
        self._mujoco.mj_step(self.model, self.data, nstep=steps)
        self._unwind()
        kinds = {one: getattr(self._mujoco.mjtWarning, f"mjWARN_{one}") for one in _BAD}
        told = [one for one, kind in kinds.items() if self.data.warning[int(kind)].number > 0]
        if told or not np.isfinite(self.data.qpos).all():
            words = f"{', '.join(told) or 'not finite'} after {self.data.time:z.2f} s of motion"
            step_ms = 1e3 * self.model.opt.timestep
            raise RobotError(
                f"the simulation diverged ({words}): its [physics] are too stiff, or its masses too"
                f" small, for steps of {step_ms:z.2g} ms"
            )
        self.touched = self.touched or self._touches()
        if self._viewer is not None and self._viewer.is_running():
            self._viewer.sync()
            time.sleep(max(0.0, duration_s - (time.monotonic() - began_s)))

    def view(self) -> None:
        """Open MuJoCo's viewer; from then on motion is shown as it is simulated.

        Raises:
            InputError: If there is no display.
        """
        import glfw

        allowed = "left out: there is no display"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not glfw.init():
                raise InputError("--viewer", True, allowed)
        from mujoco import viewer

        try:
            self._viewer = viewer.launch_passive(self.model, self.data)
        except RuntimeError as error:  # macOS: it must be run by mjpython
            raise InputError("--viewer", True, f"left out: {error}") from None

    def _touches(self) -> str:
        """Obstacle in contact with the robot now; empty if none."""
        for pair in self.model.geom_bodyid[self.data.contact.geom].tolist():
            walls = [self._walls[body] for body in pair if body in self._walls]
            if walls and not self._things.intersection(pair):
                return walls[0]
        return ""

    def _unwind(self) -> None:
        """Keep a blocked servo from running ahead of its wheel farther than its torque needs."""
        most = self.physics.wheel_torque_N_m + mjcf.SERVO_N_M_S * np.abs(self.data.ctrl)
        ahead, angle = most / mjcf.SERVO_N_M_PER_RAD, self.data.qpos[self._wheels]
        self.data.act[:] = np.clip(self.data.act, angle - ahead, angle + ahead)

    def _addresses(self, joints: Sequence[str]) -> NDArray[np.int64]:
        """Addresses of joints in MuJoCo's arrays: each has one coordinate, so that all agree."""
        return np.array([self.model.joint(name).id for name in joints], dtype=int)

    def _freeze(self, solid: Array) -> None:
        """Let metal melt, or freeze in the shape it has."""
        grown = np.maximum(solid - self._solid, 0.0)[:, None]
        share = grown / np.maximum(solid, 1e-12)[:, None]
        self._rest_rad += share * (self.data.qpos[self._bends] - self._rest_rad)
        if (solid != self._solid).any():
            self._solid = solid.copy()
            self._stiffen()

    def _stiffen(self) -> None:
        """Give the hinges the stiffness of the metal as it is."""
        pieces_m = self._lengths_m / self._hinges
        each = zip(self._bends, self._solid.tolist(), self._rest_rad, pieces_m, strict=True)
        for hinges, solid, rest_rad, piece_m in each:
            stiffness, neutral_rad = mjcf.springs(self.physics, solid, rest_rad, piece_m)
            self.model.jnt_stiffness[hinges] = stiffness
            self.model.dof_damping[hinges] = stiffness * self.physics.relaxation_s
            self.model.dof_frictionloss[hinges] = self.physics.soft_friction_N_m
            self.model.qpos_spring[hinges] = neutral_rad
