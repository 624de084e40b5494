"""A made-up log of melts and freezes: two-node segments of known parameters, by SciPy."""

from __future__ import annotations

import csv
from copy import deepcopy
from functools import cache
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from twosra_mpc import load_robot

ROBOT = load_robot("2sr-v2")
AIR_C = ROBOT.heater.ambient_C
TRUE = {"power_K_per_s": 1.3, "coupling_per_s": 0.012, "body_ratio": 3.3, "body_loss_per_s": 0.006}
BEGINS_C = ((23.0, 24.0), (52.0, 35.0), (30.0, 50.0), (45.0, 52.0), (35.0, 28.0), (52.0, 48.0))
TARGETS = ((1, 1), (1, 0), (0, 1), (1, 1), (1, 0), (1, 1))

Rows = list[dict[str, object]]


def course(
    state: list[float], heated: bool, until_C: float, power: float = 1.0, lasts_s: float = 0.0
) -> tuple[list[float], list[float]]:
    """Readings each second of (core, body, both lags) until one is at ``until_C``, and the end.

    ``power`` is in shares of the true one; with ``lasts_s`` it goes on so long, whatever is read.
    """
    p, a, beta, b = TRUE.values()
    p *= power
    lag_s, setpoint_C = 2.85, ROBOT.heater.soft_setpoint_C

    def rate(_: float, x: list[float]) -> list[float]:
        core, body, one, two = x
        rise = (p if heated else 0.0) - a * (core - body)
        rise = min(0.0, rise) if heated and core >= setpoint_C else rise
        fall = a / beta * (core - body) - b * (body - AIR_C)
        return [rise, fall, (core - one) / lag_s, (one - two) / lag_s]

    def reached(_: float, x: list[float]) -> float:
        return x[3] - until_C

    reached.terminal = True  # type: ignore[attr-defined]
    reached.direction = 1 if heated else -1  # type: ignore[attr-defined]
    stop = None if lasts_s else reached
    done = solve_ivp(rate, (0, lasts_s or 900), state, events=stop, max_step=0.2, rtol=1e-8)
    return [done.t[-1], *np.interp(np.arange(0.0, done.t[-1], 1.0), done.t, done.y[3])], list(
        done.y[:, -1]
    )


def made_up() -> tuple[Rows, Rows]:
    """Rows of both files, to be changed at will."""
    return deepcopy(_made_up())


@cache
def _made_up() -> tuple[Rows, Rows]:
    """Rows of both files: one segment melts and freezes, or both, the slower one telling when."""
    transitions: Rows = []
    readings: Rows = []
    for begins, target in zip(BEGINS_C, TARGETS, strict=True):
        soft = [j for j in (0, 1) if target[j]]
        slow = min(soft, key=lambda j: begins[j])
        for kind, until_C in (("melt", 63.0), ("freeze", 53.0)):
            rested = [begins[slow]] * 4
            state = rested if kind == "melt" else course(rested, True, 63.0)[1]
            (duration_s, *slow_C), _ = course(state, kind == "melt", until_C)
            number = len(transitions) + 1
            targets = dict(zip(("target1", "target2"), target, strict=True))
            if kind == "freeze":
                targets = dict.fromkeys(targets, 0)
            transitions.append(
                {"transition": number, **targets, "kind": kind, "duration_s": duration_s}
            )
            for i, here_C in enumerate([*slow_C, until_C]):
                other = begins[1 - slow] if kind == "melt" else min(here_C, begins[1 - slow])
                columns = {f"reading{slow + 1}_C": here_C, f"reading{2 - slow}_C": other}
                time_s = min(float(i), duration_s)
                readings.append({"transition": number, "time_s": time_s, **columns})
    return transitions, readings


def of_both(powers: tuple[float, float]) -> tuple[Rows, Rows]:
    """Rows of both files: all segments melt and freeze at once, each with a power of its own."""
    transitions: Rows = []
    readings: Rows = []
    for begins in BEGINS_C:
        states = [[begin] * 4 for begin in begins]
        for kind, until_C in (("melt", 63.0), ("freeze", 53.0)):
            given = [(s, kind == "melt", until_C, p) for s, p in zip(states, powers, strict=True)]
            lasts_s = max(course(*each)[0][0] for each in given)
            courses = [course(*each, lasts_s) for each in given]
            states, number = [end for _, end in courses], len(transitions) + 1
            targets = dict.fromkeys(("target1", "target2"), int(kind == "melt"))
            transitions.append(
                {"transition": number, **targets, "kind": kind, "duration_s": lasts_s}
            )
            told = [[*times_C[1:], end[3]] for times_C, end in courses]
            for i, (one_C, other_C) in enumerate(zip(*told, strict=True)):
                row = {"reading1_C": one_C, "reading2_C": other_C}
                time_s = min(float(i), lasts_s)
                readings.append({"transition": number, "time_s": time_s, **row})
    return transitions, readings


def write(rows: Rows, path: Path) -> Path:
    """Write rows as a CSV file."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path
