"""The page: template, style and script filled in with a plan. Nothing in it leaves the page.

A Content-Security-Policy allows this very style and script, by their hashes, and pictures that are
part of the page; whatever text a plan file carries can neither run nor fetch anything.
"""

from __future__ import annotations

import base64
import hashlib
import io
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from twosra_mpc.analysis.critical_path import critical_path, hidden_activities, in_words
from twosra_mpc.errors import InputError
from twosra_mpc.files import write_text
from twosra_mpc.plans.plan import Plan
from twosra_mpc.plans.trajectory import Samples
from twosra_mpc.plotting import TimeStretch, plot_plan
from twosra_mpc.report import reproduction, words
from twosra_mpc.report.film import film_of, filmed_box, pose_of
from twosra_mpc.report.setpoint_table import setpoint_table
from twosra_mpc.report.timeline import Thermometer, curve, lanes, ticks
from twosra_mpc.robot.modes import mode_name, sequence_name

_ENDINGS = (".html", ".htm")
_FIBRE_MM = 6.0  # drawn width where the robot file does not say


def check_report_path(path: str | Path) -> None:
    """Check that a report may be called this.

    Raises:
        InputError: If the ending is not that of a web page.
    """
    if Path(path).suffix.lower() not in _ENDINGS:
        raise InputError("output", str(path), f"a file ending in {' or '.join(_ENDINGS)}")


def write_report(plan: Plan, path: str | Path, origin: reproduction.Origin | None = None) -> None:
    """Write a report, atomically.

    Args:
        plan: The plan; of any status, also without samples.
        path: Where to; the ending is .html.
        origin: The file the plan was read from, if any.

    Raises:
        InputError: If the ending is another one, or the folder cannot be written.
    """
    check_report_path(path)
    write_text(path, report_page(plan, origin))


def report_page(plan: Plan, origin: reproduction.Origin | None = None) -> str:
    """Return the report as one HTML document that needs nothing else.

    Args:
        plan: The plan; of any status, also without samples.
        origin: The file the plan was read from, if any.
    """
    environment = Environment(
        loader=PackageLoader("twosra_mpc", "report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters |= {"mode": mode_name, "percent": words.percent, "seconds": _seconds}
    style, script = _data_file("page.css"), _data_file("page.js")
    return environment.get_template("page.html").render(
        policy=_policy(style, script),
        style=style,
        script=script,
        title=plan.problem.description or f"Plan for robot {plan.robot.name}",
        plan=plan,
        document=plan.to_dict(),
        sequence=sequence_name([phase.mode for phase in plan.phases]) if plan.phases else "",
        status_sentence=words.status_sentence(plan),
        bound_sentences=list(words.bound_sentences(plan)),
        caveat_sentences=list(words.caveat_sentences(plan)),
        verification=_verification(plan),
        path=in_words(critical_path(plan)),
        hidden=hidden_activities(plan),
        motion=_motion(plan, plan.samples) if plan.samples is not None else None,
        origin=origin,
        scenario=reproduction.scenario_toml(plan.problem),
        commands=reproduction.commands(origin),
        versions=reproduction.versions(origin),
        effort=reproduction.effort(plan),
    )


def _data_file(name: str) -> str:
    return files("twosra_mpc.report").joinpath(name).read_text(encoding="utf-8")


def _policy(style: str, script: str) -> str:
    """Content-Security-Policy that allows what is in the page and nothing else."""
    return (
        f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; "
        f"script-src '{_hash(script)}'; base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _verification(plan: Plan) -> dict[str, Any] | None:
    check = plan.verification
    if check is None:
        return None
    return {
        "ok": check.ok,
        "sentence": words.verification_sentence(check),
        "goal": words.goal_rows(plan.problem, check),
        "limits": words.limit_rows(plan, check),
    }


def _motion(plan: Plan, samples: Samples) -> dict[str, Any]:
    """Everything that is drawn: film, timeline, set-points, figure."""
    end_s = float(samples.t_s[-1])
    stretch = TimeStretch.of(plan.phases, end_s or 1.0)
    film, geometry = film_of(plan, samples, stretch), plan.robot.geometry
    scale, table = Thermometer.of(plan, samples), setpoint_table(samples)
    goal = plan.problem.goal.configuration
    aim = np.where(np.isnan(goal), samples.q[-1], goal)
    ghosts = {"start": film.poses[0], "goal": pose_of(geometry, aim)}
    box = filmed_box([*film.poses, ghosts["goal"]])
    levels = [[scale.level(t) for t in column] for column in samples.temperature_C.T.tolist()]
    return {
        "data": {
            "film": film.document(),
            "row_s": table.time_s,
            "temperature_C": [scale.low_C, scale.high_C],
        },
        "moves": end_s > 0.0,
        "first": film.poses[0],
        "ghosts": ghosts,
        "box": box,
        "grid": _grid(box),
        "fibre_mm": _fibre_mm(plan),
        "lanes": lanes(plan, samples, stretch),
        "ticks": ticks(stretch),
        "curves": [curve(samples.t_s, column, stretch) for column in levels],
        "thermometer": scale,
        "table": table,
        "figure": _figure(plan),
    }


def _fibre_mm(plan: Plan) -> float:
    segment = plan.robot.segment
    known = segment.fibre_diameter_m if segment else None
    return _FIBRE_MM if known is None else 1e3 * known


def _grid(box: tuple[float, float, float, float]) -> dict[str, Any]:
    """Lines every 50 mm, or 10, 100 or more times that far apart in a box that is not so large."""
    left, top, width, height = box
    step = next((s for s in (50, 100, 200, 500, 1000) if width / s <= 10), int(width / 5))
    return {
        "step": step,
        "x": [x for x in range(int(left // step) * step, int(left + width) + 1, step) if x > left],
        "y": [y for y in range(int(top // step) * step, int(top + height) + 1, step) if y > top],
    }


def _figure(plan: Plan) -> str:
    """The plan's figure as the address of an SVG picture inside the page."""
    picture = io.BytesIO()
    plot_plan(plan).savefig(picture, format="svg", metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(picture.getvalue()).decode()}"


def _seconds(value: float) -> str:
    """A duration as people read it: milliseconds, seconds, or minutes and seconds."""
    if 0 < value < 0.1:
        return f"{1e3 * value:.0f} ms"
    if value < 60:
        return f"{value:.2f} s"
    minutes, seconds = divmod(round(value, 1), 60.0)
    return f"{minutes:.0f} min {seconds:.1f} s"
