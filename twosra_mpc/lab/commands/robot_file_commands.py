"""``twosra check-robot``, ``fit-paths`` and ``learn``: robot files, and what is fitted to them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomlkit

from twosra_mpc.cli.options import ROBOT, Plot, RobotName, argument, command, option, written
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.errors import InputError
from twosra_mpc.execution.run import load_run
from twosra_mpc.files import write_text
from twosra_mpc.lab.bench.singular_shapes import (
    condition_number,
    singular_set_in_words,
    singular_shapes,
)
from twosra_mpc.lab.identification.bend_learning import Learned, learned, told_by
from twosra_mpc.lab.identification.path_fitting import (
    CASES,
    fit_cardioids,
    fit_spirals,
    fitted_path_tables,
)
from twosra_mpc.model.path_models import path_model
from twosra_mpc.robot.description import Robot, load_robot, robot_document
from twosra_mpc.robot.joint_bends import Uncertainty


@command("fit-paths")
def fit_paths_command(
    robot: RobotName,
    out: Annotated[Path | None, written()],
    model: Annotated[
        Literal["log_spiral_corrected", "log_spiral", "cardioid"],
        option(default="log_spiral_corrected"),
    ],
    plot: Plot,
    output: Output,
) -> None:
    """Fit spirals and cardioids to the exact paths of ROBOT (a name or a file).

    The spirals are fitted as Table I of the paper was; the table printed shows both.

    \b
    How well do spirals and cardioids follow the exact arcs?
      twosra fit-paths 2sra-v1 --plot paths.png
    A robot file for your own fibre's lengths, with its comments kept:
      twosra fit-paths my-robot.toml --model cardioid --out fitted.toml

    Options:
        out: Write a robot file with the fit.
        model: Which fit goes into --out.
        plot: Draw exact and fitted paths (png, pdf, svg).
    """
    described = load_robot(robot)
    with output.progress("fitting"):
        if out is not None:
            write_fitted_robot(robot, out, described, model)
        if plot is not None:
            from twosra_mpc.lab.figures.identification_figures import (
                plot_paths,  # matplotlib is slow
            )

            plot_paths(described, plot)
    spirals, cardioids = fit_spirals(described.geometry), fit_cardioids(described.geometry)
    document = {
        "robot": described.name,
        "path": described.path.model_dump(mode="json"),
        "cases": CASES,
        "spirals": spirals,
        "cardioids": cardioids,
    }
    rows = zip(CASES, spirals, _given(described, "scale", "growth"), strict=True)
    spiral_rows = [
        (case, f"{fit.scale:z.4f}, {fit.growth:z.4f}", own, f"{fit.rms_l:z.4f}, {fit.max_l:z.4f}")
        for case, fit, own in rows
    ]
    cardioid_rows = []
    own_cardioids = _given(described, "radius_m", "phi_per_alpha")
    for case, fit, own in zip(CASES, cardioids, own_cardioids, strict=True):
        found = f"{fit.radius_m:z.4f}, {fit.phi_per_alpha:z.4f}"
        cardioid_rows.append((case, found, own, f"{1e3 * fit.rms_m:z.3f}, {1e3 * fit.max_m:z.3f}"))

    def tables() -> None:
        of = f"in {described.name}"
        header = ("spiral", "fitted a / l, b", of, "residual / l: rms, largest")
        print_table(header, spiral_rows)
        header = ("cardioid", "fitted a [m], dphi/dalpha", of, "residual [mm]: rms, max")
        print_table(header, cardioid_rows)

    output.report(lambda: document, tables)


def _given(robot: Robot, *names: str) -> list[str]:
    """Two parameters of the robot's own path in each case; "-" where its model has none."""
    pairs = zip(*(getattr(robot.path, name, ()) for name in names), strict=True)
    return [f"{a:z.4f}, {b:z.4f}" for a, b in pairs] or ["-"] * len(CASES)


def write_fitted_robot(source: str | Path, target: str | Path, robot: Robot, model: str) -> None:
    """Write a copy of a robot file whose ``[path]`` table is fitted to its lengths.

    Everything else, comments included, stays as it is.

    Raises:
        InputError: If ``source`` is not TOML, or ``target`` cannot be written.
    """
    document = robot_document(source)
    table = tomlkit.table()
    for key, value in fitted_path_tables(robot)[model].items():
        table.add(key, value)
    table.comment("fitted to the exact paths of this robot's lengths")
    table.add(tomlkit.nl())
    document["path"] = table
    write_text(target, tomlkit.dumps(document))


@command("check-robot")
def check_robot_command(robot: RobotName, output: Output) -> None:
    """Check ROBOT (a name or a file) and report shapes in which its wheels lose control.

    \b
    A built-in robot:
      twosra check-robot 2sra-v1
    Your own, which must be a valid robot file; a mistake is named with its key:
      twosra check-robot my-robot.toml
    """
    described = load_robot(robot)
    segments, speed = described.geometry.segments, path_model(described).speed
    condition = condition_number(described, (0.0,) * segments)
    with output.progress("looking for shapes in which the wheels lose control"):
        shapes = singular_shapes(described)
    limit, model = described.limits.curvature_per_m, described.path.model
    document = {
        "robot": described.name,
        "path_model": model,
        "speed": speed,
        "curvature_limit_per_m": limit,
        "condition_number_straight": condition,
        "singular_shapes": shapes,
    }
    rows = [
        ("path model", f"{model}; v_j: {speed}"),
        ("curvature limit", f"{limit:zg} 1/m"),
        ("wheel condition number, straight", f"{condition:z.2f}"),
    ]
    for shape in shapes:
        gap = 1e3 * shape.unit_gap_m
        state = f"units {gap:z.1f} mm apart" if gap > 0 else f"units overlap by {-gap:z.1f} mm"
        kappa = ", ".join(f"{each:z.1f}" for each in shape.kappa_per_m)
        where = f"kappa = ({kappa}) 1/m; {state}"
        rows.append(("wheels singular", f"{where}; the planner does not drive near it"))
    if shapes and segments > 2:
        form = f"in {singular_set_in_words(segments)}; above, those found nearest the straight one"
        rows.append((f"of {segments} segments", form))
    if not shapes:
        rows.append(("wheels singular", "nowhere within the curvature limits, by a scan"))
    title = (described.name, described.description)
    output.report(lambda: document, lambda: print_table(title, rows))


_WITHIN = {"joint_splits": (-0.95, 0.95), "joint_relaxations": (0.0, 1.0)}


@command("learn")
def learn_command(
    runs: Annotated[tuple[Path, ...], argument()],
    robot: Annotated[str | None, option(**ROBOT)],
    out: Annotated[Path | None, written()],
    output: Output,
) -> None:
    """Learn from RUNS, files of "twosra simulate" or of your robot, how joint bends go.

    What differs between runs is what is not known before the next one: each run counts once, and
    what is learned is never narrower than how runs differ. The robot's file is copied with its
    comments and a new [uncertainty], with which "twosra plan --risk" counts.

    \b
    Learn from two runs, and plan with it:
      twosra learn run-1.json run-2.json --out learned.toml
      twosra plan paper-1 --robot learned.toml --risk mean

    Options:
        robot: Whose runs these are: a name or a file; default: as in them.
        out: Write a robot file with what is learned.
    """
    made = [load_run(path) for path in runs]
    source = robot or made[0].problem.robot.name
    described = load_robot(source)
    told = [told_by(run, described) for run in made]
    known = described.uncertainty
    found = dict[str, Learned]()
    for name, column in zip(_WITHIN, zip(*told, strict=True), strict=False):
        shown = [value for value in column if math.isfinite(value)]
        given = None if known is None else getattr(known, name)
        if len(shown) >= (1 if given else 2):
            found[name] = learned(given, shown, _WITHIN[name])
    if not found:
        least = "one bend of two soft segments" + ("" if known else " in each of two runs")
        raise InputError("runs", [str(path) for path in runs], f"at least {least}")
    changed = Uncertainty(
        **{**(dict(known) if known else {}), **{name: one.values for name, one in found.items()}}
    )
    if out is not None:
        _write(source, out, changed, found, len(runs))
    gains = [each.gain for each in told if math.isfinite(each.gain)]
    document = {
        "robot": described.name,
        "runs": [{"run": str(path), **one._asdict()} for path, one in zip(runs, told, strict=True)],
        "learned": {name: one._asdict() for name, one in found.items()},
        "gain": {"mean": np.mean(gains), "spread": np.std(gains)} if gains else None,
        "uncertainty": changed.model_dump(mode="json"),
    }

    def tables() -> None:
        rows = [(str(path), *map(_percent, one)) for path, one in zip(runs, told, strict=True)]
        print_table(("run", "split", "difference lost", "bent of what was asked"), rows)
        print_table(
            (described.name, "next run", "equally likely"),
            [
                (name, f"{one.mean:z.3f} +- {one.spread:z.3f}", ", ".join(map(str, one.values)))
                for name, one in found.items()
            ],
        )

    output.report(lambda: document, tables)


def _percent(value: float) -> str:
    return f"{100 * value:+z.1f} %" if math.isfinite(value) else "-"


def _write(
    source: str, target: Path, changed: Uncertainty, found: dict[str, Learned], runs: int
) -> None:
    """Write a copy of the robot's file; all but its ``[uncertainty]`` stays as it is."""
    document = robot_document(source)
    table = document.setdefault("uncertainty", tomlkit.table())
    for name, one in found.items():
        table[name] = list(getattr(changed, name))
        words = f"learned from {runs} run{'s' * (runs > 1)} and {Path(source).name}"
        table[name].comment(f"{words}: {one.mean:z.3f} +- {one.spread:z.3f}")
    write_text(target, tomlkit.dumps(document))
