"""The studies, by name."""

from __future__ import annotations

from benchmarks.studies.attack import AttackStudy
from benchmarks.studies.cache import Cache
from benchmarks.studies.certificate import Certificate
from benchmarks.studies.closed_loop import ClosedLoop
from benchmarks.studies.closed_loop_missions import ClosedLoopMissions
from benchmarks.studies.cold_start import ColdStart
from benchmarks.studies.comparison import Comparison
from benchmarks.studies.departure import Departure
from benchmarks.studies.faults import Faults
from benchmarks.studies.forgery import ForgeryStudy
from benchmarks.studies.goals import Goals
from benchmarks.studies.greedy import Greedy
from benchmarks.studies.growth import Growth
from benchmarks.studies.lying import Lying
from benchmarks.studies.missions import Missions
from benchmarks.studies.mutants import Mutants
from benchmarks.studies.passages import Passages
from benchmarks.studies.peers import Peers
from benchmarks.studies.pick_and_place import PickAndPlace
from benchmarks.studies.revision import Revision
from benchmarks.studies.scenes import Scenes
from benchmarks.studies.soak import Soak
from benchmarks.studies.tracker_step import TrackerSteps
from benchmarks.studies.transition_sweep import TransitionSweep
from benchmarks.study import Study

# From 300 s a freeze, through the robot as it is (253.4 s from its 65 C set-point) and one ten
# times faster, down to half a second.
_FREEZE_S = (*(300, 253.4, 150, 100, 60, 40, 25.34, 15, 10, 6, 4, 2.5, 1.5, 1, 0.5),)

STUDIES: dict[str, Study] = {
    "goals": Goals(),
    "greedy": Greedy(),
    "greedy-exactly": Greedy(exact=True),
    "published": Comparison(problems=("published",), repeats=21),
    "random-100": Comparison(problems=("random-100",)),
    "tiny": Comparison(problems=("tiny:2",), repeats=1),
    "transition-sweep": TransitionSweep(
        problems=("published:5", "random-100:10"),
        freeze_s=_FREEZE_S,
        reference_freeze_s=_FREEZE_S[1],
        repeat_budget_s=10.0,
        time_limit_s=20.0,
    ),
    "lying": Lying(),
    "forgeries": ForgeryStudy(),
    "growth": Growth(
        problems=("published:5", "random-100:3"),
        max_phases=(2, 3, 4, 5, 6, 7, 8),
        gaps=(0.01, 0.0),
        times_faster=(1.0, 10.0),
        phases=(3, 4, 5, 6, 7, 8),
        grid=(5, 10, 20, 40, 80),
        repeat_budget_s=9.0,
        time_limit_s=10.0,
    ),
    "cold-start": ColdStart(),
    "cache": Cache(problems=("published:5",), repeats=9),
    "attack": AttackStudy(),
    "certificate": Certificate(problems=("random-100:50",), repeats=1),
    "closed-loop": ClosedLoop(),
    "closed-loop-hard": ClosedLoop(level="hard", seeds=2, path_models=("arc",)),
    "closed-loop-scenes": ClosedLoop(
        problems=("scenes-100",), seeds=1, executors=("optimal",), path_models=("arc",)
    ),
    "physics": ClosedLoop(problems=("published-default",), path_models=("arc",), plant="mujoco"),
    "closed-loop-missions": ClosedLoopMissions(),
    "departure": Departure(),
    "faults": Faults(),
    "peers": Peers(problems=("published:5", "random-100:10"), repeat_budget_s=60.0),
    "missions": Missions(),
    "mutants": Mutants(),
    "passages": Passages(),
    "pick-and-place": PickAndPlace(scenarios=("pick-and-place",)),
    "revision": Revision(problems=("published", "random-100")),
    "scenes": Scenes(problems=("scenes-6", "scenes-14"), repeats=1, time_limit_s=60.0),
    "soak": Soak(),
    "tracker-step": TrackerSteps(),
}
