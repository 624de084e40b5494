"""The hardware trials: logs against simulations, where the time went, and where they ended."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from twosra_mpc.files import plain_data
from twosra_mpc.lab.figures.trial_figures import plot_distances, plot_trials
from twosra_mpc.lab.identification.motion_log import MotionLog
from twosra_mpc.lab.identification.replay import replay
from twosra_mpc.lab.paper.claims import Claim, Reading, equal, every
from twosra_mpc.lab.paper.kept import Data, Kept, Part, Tell, digest
from twosra_mpc.lab.paper.section import Picture, Section, Table
from twosra_mpc.lab.reproduction.hardware import (
    dtw_table,
    read_trials,
    trial_of,
    trial_paths,
    waiting,
)
from twosra_mpc.lab.reproduction.simulations import SIMULATIONS
from twosra_mpc.robot.coordinates import POSE
from twosra_mpc.robot.description import load_robot
from twosra_mpc.robot.modes import mode_name, sequence_name

TRIALS_FIGURE, DTW_FIGURE = "trials.png", "dtw.png"
COORDINATES = ("x", "y", "phi", "kappa_1", "kappa_2")
# Distances of the bar plot of Fig. 7(b), from the authors' published notebook.
DTW: dict[int, tuple[float, ...]] = {
    1: (429.166339, 299.797615, 385.546026, 70.606072, 117.631930),
    2: (216.660894, 645.312853, 434.557395, 290.484640, 549.796451),
    3: (275.005512, 167.720143, 123.638113, 66.678894, 155.713481),
    4: (16.625281, 57.195667, 26.168597, 99.198261, 22.733424),
    5: (355.521156, 98.367755, 275.780922, 191.731375, 42.135492),
}
Trials: TypeAlias = dict[int, Data]  # number -> what its log says, in order
_SECTION = "section Pose-Shape Formation"
STOP = 0.01  # norm of (x, y, phi) in m and rad at which the authors' program stopped
_BEST_FIT_TRIAL = 3
_MISSING = (
    "Give a folder with the logs of the trials: --logs FOLDER, or --data with hardware/ in it."
)


def part(kept: Kept, logs: Path) -> Part:
    """Return what the logs of a folder say, with figures; what each log says is kept by itself."""

    def compute(folder: Path, tell: Tell) -> Data:
        robot = load_robot("2sra-v1")
        found, compared = {}, {}
        for log in read_trials(logs, robot):
            name = Path(log.source).stem
            found[name] = kept.get(_one(name, log), tell)
            if (number := trial_of(log)) is not None and number not in compared:
                compared[number] = log
        tell("drawing the trials")
        simulated = {number: SIMULATIONS[number].run() for number in compared}
        figures = []
        if compared:
            plot_trials(compared, simulated, folder / TRIALS_FIGURE)
            ours = {
                n: found[Path(log.source).stem]["dtw"]["published"] for n, log in compared.items()
            }
            plot_distances(DTW, ours, folder / DTW_FIGURE)
            figures = [TRIALS_FIGURE, DTW_FIGURE]
        return {"logs": found, "figures": figures}

    given = {path.name: digest(path) for path in trial_paths(logs)}
    return Part("trials", {"logs": given}, compute)


def _one(name: str, log: MotionLog) -> Part:
    def compute(_folder: Path, tell: Tell) -> Data:
        tell(f"comparing {name} with the simulations")
        said: Data = plain_data(_log(log) | {"bends": _bends(log)})
        return said

    return Part(f"trial-{name}", {"log": digest(Path(log.source))}, compute)


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
        modes = SIMULATIONS[number].run().mode[1:].tolist()
        data["simulated"] = [m for k, m in enumerate(modes) if k == 0 or m != modes[k - 1]]
    return data


def _bends(log: MotionLog) -> list[Data]:
    """Ends of soft phases by the model, given the history of curvatures that was measured."""
    return [
        {
            "mode": one.mode,
            "bend_rad": one.bend_rad[-1],
            "error": error,
            "moved": one.moved,
            "split": one.split,
        }
        for one in replay(log, load_robot("2sra-v1"))
        if (error := one.error_as_bent) is not None
    ]


def section(data: Data | None) -> Section:
    """Compare the trials with the paper; without logs say what to give."""
    logs = {} if data is None else data["logs"]
    trials = _trials(logs)
    claims = [_distances(number, trials.get(number)) for number in DTW]
    claims += [judge(trials) for judge in _JUDGEMENTS]
    claims += [_equal_bends(logs), _middle_link(logs)]
    absent = [str(number) for number in DTW if number not in trials]
    missing = f"No log of trial{'s' * (len(absent) > 1)} {', '.join(absent)}. " if absent else ""
    return Section(
        name="trials",
        title="Trials on the robot",
        words=(
            "Logs of the trials are compared with our runs of the published simulations, by the"
            " authors' recipe (columns z-scored, the simulation padded to the log's length, dynamic"
            " time warping of points of row and value) and by values alone. A log belongs to the"
            " trial whose simulation starts where it does. The wait before the first row is not in"
            " a log; it is taken from the authors' program.",
        ),
        claims=tuple(claims),
        tables=(_waits(logs), _deviations(trials), _ends(trials), _bent(logs)) if logs else (),
        pictures=tuple(
            Picture(file, words)
            for file, words in (
                (DTW_FIGURE, "Distances by dynamic time warping, published and found"),
                (
                    TRIALS_FIGURE,
                    "Trials and their simulations; how the error decreases with the waits counted",
                ),
            )
            if data is not None and file in data["figures"]
        ),
        missing=missing + (_MISSING if absent else ""),
    )


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
        equal(name, published, ours, holds=1e-3 * published, caveat=0.05 * published)
        for name, published, ours in zip(COORDINATES, DTW[number], found, strict=True)
    )
    note = "Row numbers are part of these distances, so they mostly say how the lengths differ."
    return Claim(f"DTW distances of trial {number}", "Fig. 7(b)", readings, note)


def _pattern(trials: Trials) -> Claim:
    pairs = [(one["simulated"], one["sequence"]) for one in trials.values()]
    return Claim(
        "Simulation and robot show a similar pattern of movement",
        _SECTION,
        (
            every(
                "trials with the modes of their simulation",
                _mean([list(simulated) == list(driven) for simulated, driven in pairs]),
            ),
            every(
                "trials with no other modes, and in its order",
                _mean([_in_order(driven, simulated) for simulated, driven in pairs]),
            ),
        ),
        "The authors' program had modes disabled by hand in some of the trials.",
    )


def _in_order(part_of: list[Any], whole: list[Any]) -> bool:
    """True if a sequence is another one with some left out."""
    rest = iter(whole)
    return all(one in rest for one in part_of)


def _differences(trials: Trials) -> Claim:
    sequences = [sequence_name(one["sequence"]) for one in trials.values()]
    times = [round(_total_s(one["waiting"])) for one in trials.values()]
    return Claim(
        "The trials differ in modes and in time",
        _SECTION,
        (
            every("different sequences", _distinct(sequences)),
            every("different times, to a second", _distinct(times)),
        ),
    )


def _best_fit(trials: Trials) -> Claim:
    off = None
    if _BEST_FIT_TRIAL in trials:
        x, y, *others = trials[_BEST_FIT_TRIAL]["dtw"]["published"]
        off = max(others) - min(x, y)
    words = "their largest distance less the smallest one of x and y"
    return Claim(
        f"In trial {_BEST_FIT_TRIAL} heading and curvatures fit best",
        f"{_SECTION}; Fig. 7(a)",
        (Reading(words, 0.0, off, "", 0.0, 0.0, "at most"),),
    )


def _errors(trials: Trials) -> Claim:
    nearest = [near for one in trials.values() for near in one["nearest"]]
    off = [1e3 * value for one in trials.values() for value in one["dtw"]["mean"][:2]]
    words = "largest mean deviation of x or y, against the limit at which trials stop"
    limit = 1e3 * STOP
    return Claim(
        "The errors between simulation and robot are not significant",
        f"{_SECTION}; Fig. 7(b)",
        (
            every(
                "distances that are least, of all simulations, to the trial's own", _mean(nearest)
            ),
            Reading(words, limit, max(off, default=None), "mm", 0.0, limit, "at most"),
        ),
    )


def _stop(trials: Trials) -> Claim:
    left = [float(np.linalg.norm(one["waiting"]["final_error"][:POSE])) for one in trials.values()]
    words = "largest norm of x, y, heading at the end [m, rad]"
    whole = [float(np.linalg.norm(one["waiting"]["final_error"])) for one in trials.values()]
    with_bends = "the same with the curvatures, as the paper's measure has them [m, rad, 1/m]"
    return Claim(
        "The trials stop when the error is below a limit",
        f"{_SECTION}; Fig. 7(c)",
        (
            Reading(words, STOP, max(left, default=None), "", 0.1 * STOP, STOP, "at most"),
            Reading(with_bends, STOP, max(whole, default=None), "", 0.1 * STOP, STOP, "at most"),
        ),
        "Curvatures are not part of the limit in the authors' program; they end several 1/m off.",
    )


def _axes(trials: Trials) -> Claim:
    words = "share of the time that is waiting"
    shares = {
        f"trial {n}: {words}": 100.0 * one["waiting"]["share_waiting"] for n, one in trials.items()
    }
    found: dict[str, float | None] = {**shares} or {words: None}
    return Claim(
        "The axes of Fig. 7(a, c) are the time the trials took",
        "Fig. 7(a, c)",
        tuple(equal(name, 0.0, one, "%", holds=5.0, caveat=20.0) for name, one in found.items()),
        "The logs have no rows while metal melts or freezes, and the figures count rows.",
    )


def _equal_bends(logs: Data) -> Claim:
    splits = [one["split"] for log in logs.values() for one in log["bends"] if sum(one["mode"]) > 1]
    worst = 100 * max(splits) if splits else None
    words = "largest deviation of a segment's bend from the mean of both"
    return Claim(
        "Two soft segments bend equally",
        "section LU Paths Estimation, spiral III",
        (Reading(words, 0.0, worst, "%", 5.0, 20.0, "at most"),),
        "Measured where both are bent together by 0.2 rad at least, from start to end of the phase."
        " Rigid bodies on a fibre of hinges bend unequally, too: which unit pushes matters.",
    )


def _middle_link(logs: Data) -> Claim:
    off = [
        1e3 * math.hypot(*one["error"][:2])
        for log in logs.values()
        for one in log["bends"]
        if sum(one["mode"]) == 1
    ]
    words = "largest distance of the middle link from where it should be after such a phase"
    return Claim(
        "While one segment is soft the rest of the fibre stays, or moves, as the arcs have it",
        "section Unified Jacobian Matrix, cases I and II",
        (Reading(words, 0.0, max(off, default=None), "mm", 5.0, 20.0, "at most"),),
        "By exact arcs, along the measured history of curvatures: in case I the link should not"
        " move at all.",
    )


_JUDGEMENTS = (_pattern, _differences, _best_fit, _errors, _stop, _axes)


def _mean(values: list[bool]) -> float | None:
    return float(np.mean(values)) if values else None


def _distinct(values: list[Any]) -> float | None:
    """Share of the values that differ from all before them; None of less than two."""
    return len(set(values)) / len(values) if len(values) > 1 else None


def _total_s(spent: Data) -> float:
    return float(spent["first_heating_s"] + spent["waits_s"] + spent["motion_s"])


def _waits(logs: Data) -> Table:
    rows = [
        (
            name,
            "-" if one["trial"] is None else str(one["trial"]),
            sequence_name(one["sequence"]),
            f"{one['waiting']['first_heating_s']:z.0f}",
            f"{one['waiting']['waits_s']:z.0f}",
            f"{one['waiting']['motion_s']:z.0f}",
            f"{_total_s(one['waiting']):z.0f}",
            f"{100 * one['waiting']['share_waiting']:z.1f} %",
        )
        for name, one in logs.items()
    ]
    published = [one["waiting"] for one in _trials(logs).values()]
    waited = sum(one["first_heating_s"] + one["waits_s"] for one in published)
    total = sum(map(_total_s, published))
    if total:
        share = f"{100 * waited / total:z.1f} %"
        moved = f"{total - waited:z.0f}"
        rows.append(
            (
                f"{len(published)} trials together",
                "",
                "",
                "",
                f"{waited:z.0f}",
                moved,
                f"{total:z.0f}",
                share,
            )
        )
    header = (
        "log",
        "trial",
        "modes",
        "first heating [s]",
        "waits [s]",
        "motion [s]",
        "all [s]",
        "waiting",
    )
    return Table("Where the time went", header, tuple(rows), numbers=3)


def _deviations(trials: Trials) -> Table:
    rows = []
    for number, one in trials.items():
        pairs = zip(_in_units(one["dtw"]["mean"]), _in_units(one["dtw"]["largest"]), strict=True)
        cells = [f"{mean:z.1f} ({largest:z.1f})" for mean, largest in pairs]
        rows.append((f"trial {number}", *cells))
    return Table("Deviation by values alone: mean (largest)", ("", *_UNITS), tuple(rows))


_UNITS = ("x [mm]", "y [mm]", "phi [deg]", "kappa_1 [1/m]", "kappa_2 [1/m]")


def _in_units(q: Any) -> list[float]:
    """Configuration in mm, degrees, 1/m."""
    return [1e3 * q[0], 1e3 * q[1], float(np.degrees(q[2])), *q[3:]]


def _ends(trials: Trials) -> Table:
    rows = [
        (f"trial {n}", *(f"{v:+z.1f}" for v in _in_units(one["waiting"]["final_error"])))
        for n, one in trials.items()
    ]
    return Table("Error at the end: last row less target", ("", *_UNITS), tuple(rows))


def _bent(logs: Data) -> Table:
    rows = [
        (
            name,
            mode_name(one["mode"]),
            f"{one['bend_rad']:+z.2f}",
            *_off(one["error"], one["moved"]),
        )
        for name, log in logs.items()
        for one in log["bends"]
    ]
    header = ("log", "mode", "bend [rad]", "place [mm]", "still [mm]", "phi [rad]", "still [rad]")
    words = (
        "Error of exact arcs at the end of soft phases, given the measured history of curvatures;"
        ' beside it that of "nothing moves"'
    )
    return Table(words, header, tuple(rows), numbers=2)


def _off(*errors: Any) -> list[str]:
    """Distances [mm] of some configurations' errors, then their headings' [rad]."""
    places = [f"{1e3 * float(np.hypot(*error[:2])):z.0f}" for error in errors]
    return places + [f"{abs(error[2]):z.2f}" for error in errors]
