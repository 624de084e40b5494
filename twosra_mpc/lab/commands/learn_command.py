"""``twosra learn``: what runs tell of joint bends, for the next plan."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import tomlkit

from twosra_mpc.cli.options import ROBOT, argument, command, option, written
from twosra_mpc.cli.output import Output, print_table
from twosra_mpc.errors import InputError
from twosra_mpc.execution.run import load_run
from twosra_mpc.files import write_text
from twosra_mpc.lab.identification.bend_learning import Learned, learned, told_by
from twosra_mpc.robot.description import load_robot, robot_document
from twosra_mpc.robot.joint_bends import Uncertainty

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
