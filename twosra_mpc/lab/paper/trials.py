"""The hardware trials: logs against simulations, where the time went, and where they ended."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from twosra_mpc.files import attributes
from twosra_mpc.lab.figures.experiment_figures import plot_distances, plot_trials
from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.identification.replay import replay
from twosra_mpc.lab.paper.section import Claim, Data, Reading, Section, Tell, declared
from twosra_mpc.lab.reproduction.hardware import dtw_table, read_trials, trial_of, waiting
from twosra_mpc.lab.reproduction.published_runs import SIMULATIONS
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.description import load_robot
from twosra_mpc.robot.modes import sequence_name

TRIALS_FIGURE, DTW_FIGURE = "trials.png", "dtw.png"
COORDINATES = ("x", "y", "phi", "kappa_1", "kappa_2")
DTW = {number: simulation.dtw for number, simulation in SIMULATIONS.items()}
Trials: TypeAlias = dict[int, Data]  # number -> what its log says, in order
_BEST_FIT_TRIAL = 3  # by the paper


def compute(folder: Path, tell: Tell, logs: Path) -> Data:
    """Compare the logs of a folder with the simulations, with figures."""
    found: Data = {}
    compared: dict[int, tuple[MotionLog, tuple[float, ...]]] = {}
    for log in read_trials(logs, load_robot("2sra-v1")):
        name = Path(log.source).stem
        tell(f"comparing {name} with the simulations")
        found[name] = _log(log) | {"bends": _bends(log)}
        if (number := trial_of(log)) is not None:
            compared.setdefault(number, (log, found[name]["dtw"].published))
    figures = []
    if compared:
        tell("drawing the trials")
        simulated = {number: SIMULATIONS[number].run() for number in compared}
        plot_trials({n: log for n, (log, _) in compared.items()}, simulated, folder / TRIALS_FIGURE)
        plot_distances(DTW, {n: ours for n, (_, ours) in compared.items()}, folder / DTW_FIGURE)
        figures = [DTW_FIGURE, TRIALS_FIGURE]
    return {"logs": found, "figures": figures}


def _log(log: MotionLog) -> Data:
    """Data of one log; distances only from where a trial is known to start."""
    number = trial_of(log)
    goal = None if number is None else SIMULATIONS[number].goal
    data: Data = {"trial": number, "waiting": waiting(log, goal), "dtw": None, "nearest": None}
    data["sequence"] = data["waiting"].sequence
    if number is not None:
        rows = {n: dtw_table(log, simulation.run()) for n, simulation in SIMULATIONS.items()}
        distances = np.array([row.published for row in rows.values()])
        data["dtw"] = rows[number]
        data["nearest"] = (distances.argmin(axis=0) == list(rows).index(number)).tolist()
        data["simulated"] = SIMULATIONS[number].run().sequence
    return data


def _bends(log: MotionLog) -> list[Data]:
    """Ends of soft phases by the model, given the history of curvatures that was measured."""
    return [
        {"bend_rad": one.bend_rad[-1], "error": error, **attributes(one, "mode", "moved", "split")}
        for one in replay(log, load_robot("2sra-v1"))
        if (error := one.error_as_bent) is not None
    ]


def section(data: Data | None) -> Section:
    """Compare the trials with the paper; without logs say what to give."""
    logs, pictures = ({}, ()) if data is None else (data["logs"], data["figures"])
    trials = _trials(logs)
    absent = [str(number) for number in DTW if number not in trials]
    made = declared(
        "trials",
        _of_trials(trials) | _of_bends(logs),
        (_waits(logs, trials), _deviations(trials), _ends(trials), _bent(logs)) if logs else (),
        pictures,
        missing=bool(absent),
        others=[_distances(number, trials.get(number)) for number in DTW],
    )
    if not absent:
        return made
    told = f"No log of trial{'s' * (len(absent) > 1)} {', '.join(absent)}. "
    return replace(made, missing=told + made.missing)


def _trials(logs: Data) -> Trials:
    """The first log of each trial, in order of the trials."""
    of: Trials = {}
    for one in logs.values():
        if one["trial"] is not None:
            of.setdefault(one["trial"], one)
    return dict(sorted(of.items()))


def _distances(number: int, trial: Data | None) -> Claim:
    found = [None] * len(COORDINATES) if trial is None else trial["dtw"]["published"]
    readings = tuple(
        Reading(name, published, ours, "", 1e-3 * published, 0.05 * published)
        for name, published, ours in zip(COORDINATES, DTW[number], found, strict=True)
    )
    note = "Row numbers are part of these distances, so they mostly say how the lengths differ."
    return Claim(f"DTW distances of trial {number}", "Fig. 7(b)", readings, note)


def _of_trials(trials: Trials) -> Data:
    """Numbers that claims about all trials, and about the one that fits best, are about."""
    pairs = [(one["simulated"], one["sequence"]) for one in trials.values()]
    errors = [one["waiting"]["final_error"] for one in trials.values()]
    off_m = [value for one in trials.values() for value in one["dtw"]["mean"][:2]]
    best = trials[_BEST_FIT_TRIAL]["dtw"]["published"] if _BEST_FIT_TRIAL in trials else None
    waits = {n: 100.0 * one["waiting"]["share_waiting"] for n, one in trials.items()}
    return {
        "same_modes": _mean([list(simulated) == list(driven) for simulated, driven in pairs]),
        "modes_in_order": _mean([_in_order(driven, simulated) for simulated, driven in pairs]),
        "different_sequences": _distinct([sequence_name(driven) for _, driven in pairs]),
        "different_times": _distinct([round(o["waiting"]["total_s"]) for o in trials.values()]),
        "others_above_x_y_of_trial_3": best and max(best[2:]) - min(best[:2]),
        "nearest": _mean([near for one in trials.values() for near in one["nearest"]]),
        "largest_deviation_mm": _most(off_m, 1e3),
        "pose_left": _most([np.linalg.norm(error[:POSE]) for error in errors]),
        "left": _most([np.linalg.norm(error) for error in errors]),
        **{f"waiting_{number}": waits.get(number) for number in DTW},
    }


def _in_order(part_of: list[Any], whole: list[Any]) -> bool:
    """True if a sequence is another one with some left out."""
    rest = iter(whole)
    return all(one in rest for one in part_of)


def _of_bends(logs: Data) -> Data:
    """Numbers that claims about bends are about, of all logs."""
    bends = [one for log in logs.values() for one in log["bends"]]
    off_m = [math.hypot(*one["error"][:2]) for one in bends if sum(one["mode"]) == 1]
    splits = [one["split"] for one in bends if sum(one["mode"]) > 1]
    return {"split": _most(splits, 100.0), "link_off_mm": _most(off_m, 1e3)}


def _most(values: list[Any], times: float = 1.0) -> float | None:
    return times * float(max(values)) if values else None


def _mean(values: list[bool]) -> float | None:
    return float(np.mean(values)) if values else None


def _distinct(values: list[Any]) -> float | None:
    """Share of the values that differ from all before them; None of less than two."""
    return len(set(values)) / len(values) if len(values) > 1 else None


def _waits(logs: Data, trials: Trials) -> Iterator[Data]:
    """Lines of the table of times, the last of all trials together."""
    for name, one in logs.items():
        of = one["waiting"]
        yield {**of, "name": name, "trial": one["trial"], "waiting": 100 * of["share_waiting"]}
    if trials:
        every = [one["waiting"] for one in trials.values()]
        waits_s = sum(one["first_heating_s"] + one["waits_s"] for one in every)
        total_s = sum(one["total_s"] for one in every)
        blank = {"trial": "", "sequence": "", "first_heating_s": ""}
        times = {"waits_s": waits_s, "motion_s": total_s - waits_s, "total_s": total_s}
        words = f"{len(trials)} trials together"
        yield {"name": words, **blank, **times, "waiting": 100 * waits_s / total_s}


def _deviations(trials: Trials) -> Iterator[Data]:
    """Lines of the table of deviations by values alone."""
    for number, one in trials.items():
        mean, largest = (_in_units(one["dtw"][name]) for name in ("mean", "largest"))
        yield {"trial": number, "mean": mean, "largest": largest}


def _in_units(q: Any) -> list[float]:
    """Configuration in mm, degrees, 1/m."""
    return [1e3 * q[0], 1e3 * q[1], float(np.degrees(q[2])), *q[3:]]


def _ends(trials: Trials) -> Iterator[Data]:
    """Lines of the table of errors at the end."""
    for number, one in trials.items():
        yield {"trial": number, "error": _in_units(one["waiting"]["final_error"])}


def _bent(logs: Data) -> Iterator[Data]:
    """Lines of the table of ends of soft phases."""
    for name, log in logs.items():
        for one in log["bends"]:
            off, still = _off(one["error"]), _off(one["moved"])
            yield {**one, "name": name, "modes": [one["mode"]], "off": off, "still": still}


def _off(error: Any) -> tuple[float, float]:
    """Distance [mm] and turn [rad] of a configuration's error."""
    return 1e3 * float(np.hypot(*error[:2])), abs(error[2])
