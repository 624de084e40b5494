"""Plan files checked and turned into others: ``twosra verify``, ``resample`` etc."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from twosra_mpc import (
    InputError,
    PlanCheck,
    check_plan,
    load_plan,
    plotting,
    refined,
    save_setpoints,
)
from twosra_mpc.checking.plan_file import Check
from twosra_mpc.cli import options
from twosra_mpc.cli.output import Exit, Output, counting, print_table
from twosra_mpc.errors import MISSING
from twosra_mpc.files import attributes
from twosra_mpc.installation import require
from twosra_mpc.problem.tolerances import UNPROVED

if TYPE_CHECKING:
    from twosra_mpc.checking.certificate import Proof
    from twosra_mpc.plans.plan import Plan

_ROUNDING = 1e-9  # relative


@options.command("verify")
def verify_command(
    plans: Annotated[tuple[str, ...], options.argument("PLAN...", type=options.SOURCE)],
    proof: bool,
    output: Output,
) -> int:
    """Check PLAN files independently of what they say of themselves.

    The samples are integrated again by another method, and every rule is tested for the robot and
    the scenario in the file: limits, goal, order of stiffness, heaters, metal. Energy, cost and gap
    are worked out again. That the lower bound is one takes planning again, or a plan that was made
    with --proof: then --proof checks its certificate, in interval arithmetic, by code that shares
    nothing with the planner.

    \b
    Is this plan safe to run, and what are its margins?
      twosra verify plan.json
    In a script, by the exit code alone (0 verified, 4 not verified, 2 not a plan file):
      twosra verify --quiet plan.json && echo go
    Several plans, for a program to read:
      twosra verify plan.json other.json --json
    And does its certificate prove that no plan costs less?
      twosra verify plan.json --proof

    Options:
        proof: Prove the lower bound anew by the certificates.
    """
    code = Exit.PLANNED
    checked: dict[str, PlanCheck] = {}
    with output.progress("verifying") as tell:
        for path in plans:
            tell(f"verifying {path}")
            try:
                checked[path] = _with_proof(check_plan(path)) if proof else check_plan(path)
            except InputError as error:
                click.echo(f"twosra: {error}", err=True)
                code = Exit.BAD_INPUT
    documents = [
        {"file": path, "verified": check.ok, "status": str(check.result.status)}
        | attributes(check, "problems", "checks")
        for path, check in checked.items()
    ]
    if checked:
        output.report(lambda: documents, lambda: _print_verdicts(checked))
    return code if all(check.ok for check in checked.values()) else Exit.NO_PLAN


def _with_proof(found: PlanCheck) -> PlanCheck:
    """Findings, with whether the certificate proves its own bound and the one reported."""
    require("--proof", "proof", "python-flint")
    from twosra_mpc.checking.certificate import check

    result = found.result
    if result.certificate is None:
        raise InputError("certificate", MISSING, "a plan that was made with --proof")
    proof, claimed = check(result.problem, result.certificate), result.certificate.get("bound_s")
    cost = math.inf if result.plan is None else result.plan.cost.total
    checks = [*_proved(proof, claimed, result.lower_bound or 0.0, cost)]
    if result.plan is not None and result.plan.confirmed_lower_bound is not None:
        checks.append(_confirmed(result.plan, proof))
    false = (f"{one.name}: {one.found}" for one in checks if not one.ok)
    return replace(found, checks=(*found.checks, *checks), problems=(*found.problems, *false))


def _proved(proof: Proof, claimed: object, reported: float, cost: float) -> Iterator[Check]:
    """Compare what is proved with what is claimed and reported, and with what the plan costs."""
    as_claimed = isinstance(claimed, int | float) and proof.bound >= claimed * (1 - _ROUNDING)
    enough = reported * (1 - UNPROVED)
    parts = f"{len(proof.parts)} parts"
    text = f"proves {proof.bound:z.3f} s in {parts}; {reported:z.3f} s are reported"
    if (more := reported - proof.bound) > 0:
        text = f"{text}, {more:z.3f} s ({100 * more / reported:z.2g} %) more than is proved"
    text += "" if as_claimed else f"; {claimed!r} s are claimed by the certificate"
    ok = as_claimed and proof.bound >= enough
    yield Check("certificate", text, ok, proof.bound - enough, "s")
    below = proof.bound - cost
    if below > _ROUNDING * cost:
        text = f"no plan costs less than {proof.bound:z.3f} s is proved, but this one costs"
        text = f"{text} {cost:z.3f} s: it breaks a rule, or the proof is wrong"
        yield Check("contradiction", text, ok=False, margin=-below, unit="s")


def _confirmed(plan: Plan, proof: Proof) -> Check:
    """Bound anew the time until all is known to be done, by the planner's own search."""
    from twosra_mpc.planning.confirmed_bound import confirmed_lower_bound

    stated = plan.confirmed_lower_bound or 0.0
    found = confirmed_lower_bound(replace(plan, lower_bound=proof.bound)) or 0.0
    margin = found - stated * (1 - UNPROVED)
    text = f"{stated:z.3f} s is claimed; {found:z.3f} s is found anew"
    return Check("confirmed bound", text, margin >= 0, margin, "s")


def _print_verdicts(checked: dict[str, PlanCheck]) -> None:
    for path, found in checked.items():
        rows = []
        for check in found.checks:
            margin = "" if check.margin is None else f"{check.margin:z.3g} {check.unit}"
            rows.append(("PASS" if check.ok else "FAIL", check.name, check.found, margin))
        print_table(("", Path(path).name, "found", "margin"), rows)
        verdict = "verified" if found.ok else "NOT VERIFIED"
        click.echo("\n  ".join([f"{path}: {verdict}", *found.problems]))


@options.command("resample")
def resample_command(
    plan: Annotated[Path, options.argument()],
    out: Annotated[Path, options.out_argument(options.ending(".csv", ".json"))],
    rate_Hz: Annotated[float, options.RATE],
    output: Output,
) -> None:
    """Write the set-points of PLAN at a regular rate to OUT, a .csv or a .json file.

    CSV has rows at the ticks and where phases begin and end, for a controller that sends a row and
    waits for the next one. Wheel speeds are means until then, so that every wheel turns as far as
    planned. JSON stays a plan, whose inputs are ramps from a sample to the next: samples are added
    at the ticks, and those of the plan stay. "twosra verify" accepts the outcome.

    \b
    Set-points for a controller that runs at 20 Hz:
      twosra resample plan.json setpoints.csv --rate 20
    The same plan, dense enough to look at:
      twosra resample plan.json dense.json --rate 5

    Options:
        rate_Hz: Ticks per second.
    """
    loaded = load_plan(plan)
    given = loaded.require()
    with output.progress(f"resampling at {rate_Hz:zg} Hz"):
        if out.suffix.lower() == ".csv":
            save_setpoints(given, out, rate_Hz)
        else:
            replace(loaded, plan=refined(given, rate_Hz)).save(out)
    document = {"file": str(out), "rate_Hz": rate_Hz, "duration_s": given.duration_s}
    output.record((given.robot.name, "resampled"), document)


@options.command("animate")
def animate_command(
    plan: Annotated[Path, options.argument()],
    out: Annotated[Path, options.out_argument(options.film)],
    seconds: Annotated[float, options.option(type=options.Finite(1.0, 120.0), default=12.0)],
    output: Output,
) -> None:
    """Animate PLAN, a plan file, into OUT (gif; mp4 with ffmpeg).

    Waits are compressed, motion is slowed down, and a clock shows the time.

    \b
    A plan and its film:
      twosra plan paper-1 --out plan.json
      twosra animate plan.json plan.gif
    The same in a hurry:
      twosra animate plan.json short.gif --seconds 4

    Options:
        seconds: Length of the animation [s].
    """
    made = load_plan(plan).require()
    with output.progress("animating") as tell:
        shown = counting(tell, "animating: frame")
        plotting.animate_plan(made, out, duration_s=seconds, on_progress=shown)
    document = {"file": str(out), "bytes": out.stat().st_size}
    output.record((made.robot.name, "animation"), document)
