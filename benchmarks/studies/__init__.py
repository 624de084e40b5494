"""The studies by name, on the small standing sets that all tables are made of, and in full."""

from __future__ import annotations

from typing import Any

from benchmarks.studies.attack import AttackStudy
from benchmarks.studies.carried import OUTLINES, Carried
from benchmarks.studies.certificate import Certificate
from benchmarks.studies.closed_loop import ClosedLoop
from benchmarks.studies.closed_loop_missions import ClosedLoopMissions
from benchmarks.studies.cold_start import ColdStart
from benchmarks.studies.comparison import Comparison
from benchmarks.studies.departure import Departure
from benchmarks.studies.faults import Faults
from benchmarks.studies.files import Files
from benchmarks.studies.forgery import ForgeryStudy
from benchmarks.studies.goals import Goals
from benchmarks.studies.greedy import Greedy
from benchmarks.studies.lying import Lying
from benchmarks.studies.missions import Missions
from benchmarks.studies.mutants import TESTS, Mutants
from benchmarks.studies.paper import Paper
from benchmarks.studies.passages import Passages
from benchmarks.studies.peers import Enumeration, Peers, TimeGridMinlp
from benchmarks.studies.pick_and_place import PickAndPlace
from benchmarks.studies.revision import Revision
from benchmarks.studies.scenes import Scenes
from benchmarks.studies.soak import Soak
from benchmarks.studies.soft_phases import SoftPhases
from benchmarks.studies.tracker_step import TrackerSteps
from benchmarks.studies.transition_sweep import TransitionSweep
from benchmarks.study import Study

_FREEZE_S = 253.4  # of a segment of the robot as it is, from its 65 C set-point

STUDIES: dict[str, Study] = {
    "greedy": Greedy(),
    "greedy-exactly": Greedy(exact=True),
    "published": Comparison(problems=("published",), repeats=2),
    "random-100": Comparison(problems=("random-100:25",), repeats=1),
    "peers": Peers(
        problems=("published:1",),
        repeats=3,
        minlp=TimeGridMinlp(time_limit_s=10.0),
        enumeration=Enumeration(max_phases=3),
    ),
    "scenes": Scenes(problems=("scenes-6:6", "scenes-14:6"), repeats=1),
    "passages": Passages(),
    "missions": Missions(),
    "pick-and-place": PickAndPlace(scenarios=("pick-and-place",), repeats=1),
    "transition-sweep": TransitionSweep(
        problems=("published:5", "random-100:5"),
        freeze_s=(_FREEZE_S, 150, 60, 25),
        reference_freeze_s=_FREEZE_S,
        repeats=1,
        time_limit_s=3.0,
    ),
    "goals": Goals(),
    "attack": AttackStudy(),
    "certificate": Certificate(problems=("random-100:1",), repeats=1),
    "forgeries": ForgeryStudy(),
    "mutants": Mutants(),
    "closed-loop": ClosedLoop(),
    "closed-loop-hard": ClosedLoop(
        problems=("published-default",), level="hard", executors=("optimal",)
    ),
    "closed-loop-none": ClosedLoop(
        problems=("published",),
        level="none",
        executors=("optimal",),
        plant="as-planned",
        risk="nominal",
    ),
    "closed-loop-scenes": ClosedLoop(problems=("scenes-100:6",), executors=("optimal",)),
    "physics": ClosedLoop(
        problems=("published-default",),
        seeds=2,
        executors=("optimal",),
        plant="mujoco",
    ),
    "closed-loop-missions": ClosedLoopMissions(),
    "carried": Carried(),
    "departure": Departure(),
    "faults": Faults(executors=("optimal",)),
    "lying": Lying(),
    "files": Files(),
    "tracker-step": TrackerSteps(),
    "soft-phases": SoftPhases(),
    "soak": Soak(),
    "cold-start": ColdStart(),
    "revision": Revision(problems=("published:3", "random-100:3"), repeats=3),
    "paper": Paper(),
}
_LOOP = {"problems": ("published-default", "random-100:20"), "path_models": ("arc", "log_spiral")}
FULL: dict[str, dict[str, Any]] = {  # what differs where hours do not matter
    "published": {"repeats": 21},
    "random-100": {"problems": ("random-100",), "repeats": 5},
    "peers": {
        "problems": ("published:5", "random-100:10"),
        "repeats": 5,
        "repeat_budget_s": 60.0,
        "minlp": TimeGridMinlp(),
        "enumeration": Enumeration(),
    },
    "scenes": {"problems": ("scenes-6", "scenes-14")},
    "missions": {"count": 10, "goals": (2, 3, 4), "boxes_per_m": (5.0, 10.0, 15.0, 20.0)},
    "pick-and-place": {"repeats": 3},
    "transition-sweep": {
        "problems": ("published:5", "random-100:10"),
        "freeze_s": (300, _FREEZE_S, 150, 100, 60, 40, 25.34, 15, 10, 6, 4, 2.5, 1.5, 1, 0.5),
        "time_limit_s": 20.0,
    },
    "goals": {"count": 2000},
    "attack": {"count": 600},
    "certificate": {"problems": ("random-100:25",), "times_faster": (1.0, 10.0, 50.0)},
    "forgeries": {"count": 100},
    "mutants": {"count": 12, "modules": tuple(TESTS)},
    "closed-loop": {**_LOOP, "seeds": 8},
    "closed-loop-hard": {**_LOOP, "seeds": 2, "executors": ("optimal", "greedy")},
    "closed-loop-scenes": {"problems": ("scenes-100",)},
    "physics": {"seeds": 8, "executors": ("optimal", "greedy")},
    "closed-loop-missions": {"seeds": 10},
    "carried": {"outlines": tuple(OUTLINES), "paths": 12, "robots": 3},
    "departure": {"problems": ("random-100:25",), "seeds": 2},
    "faults": {"count": 100, "executors": ("optimal", "greedy")},
    "lying": {"count": 40, "sound": 1000},
    "files": {"count": 400},
    "tracker-step": {"runs": 6, "states": 400},
    "soft-phases": {"robots": 50},
    "soak": {"count": 20_000, "robots": 1000},
    "cold-start": {"rounds": 21},
    "revision": {"problems": ("published", "random-100"), "repeats": 5},
    "paper": {"problems": 1000},
}
