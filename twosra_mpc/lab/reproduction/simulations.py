"""The five published simulations: their tasks, and what else they were run with.

Source: the authors' simulated trajectories (2sr-agent-simulation), published with Labazanova et
al., IEEE RA-L 2023, doi 10.1109/LRA.2023.3241749. Start and goal are those of the built-in
scenarios; trial n of the hardware has the task ``paper-n``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

from twosra_mpc.lab.reproduction.published_runs import PublishedTrajectory, published_trajectory
from twosra_mpc.problem.problem import load_problem
from twosra_mpc.robot.coordinates import Array


@dataclass(frozen=True)
class Simulation:
    """A published simulation.

    Attributes:
        number: Its number in the authors' data.
        task: Scenario with its start and goal.
        step_s: Time step.
        switches: Iterations at which the mode changed. The published rule looks at the last bit of
            the configuration, on which C libraries differ; so they are given.
    """

    number: int
    task: str
    step_s: float
    switches: tuple[int, ...]

    @cached_property
    def start(self) -> Array:
        """First configuration [m, m, rad, 1/m, 1/m], (5,)."""
        return load_problem(self.task).start.configuration

    @cached_property
    def goal(self) -> Array:
        """Target [m, m, rad, 1/m, 1/m], (5,)."""
        return load_problem(self.task).goal.configuration

    @cache  # noqa: B019 (five values in all)
    def run(self) -> PublishedTrajectory:
        """The published trajectory, to rounding error."""
        return published_trajectory(
            self.start, self.goal, step_s=self.step_s, switch_iterations=self.switches
        )

    @cache  # noqa: B019 (the same)
    def run_freely(self) -> PublishedTrajectory:
        """The published loop on the same task, switching where the last bit tells it to here."""
        return published_trajectory(self.start, self.goal, step_s=self.step_s)


# Trial of the hardware -> its simulation; trial n has the task paper-n.
SIMULATIONS = {
    1: Simulation(4, "paper-1", 0.05, (162, 216, 254)),
    2: Simulation(2, "paper-2", 0.05, (162,)),
    3: Simulation(3, "paper-3", 0.05, (166, 216, 253)),
    4: Simulation(1, "paper-4", 0.05, (163,)),
    5: Simulation(5, "paper-5", 0.1, (74, 93)),
}
