"""Paths in the plane: lists of points, as CSV and SVG files and Bezier curves have them."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from twosra_mpc.errors import InputError
from twosra_mpc.files import read_text, reading
from twosra_mpc.robot.coordinates import Array

_SAGITTA_M = 2e-5  # of the chords that stand for a curve
_SVG_M = 1e-3  # of a unit of SVG files
_SAME_M = 1e-9  # points as near to each other are one
_JUMP, _MANY = 20.0, 10  # times the median step, where there are so many
_SVG = re.compile(r"([A-Za-z])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_CUSP_RAD = 3.0  # turns by more are back, and no bend does instead
_CLOCK = "t_s"  # column of times
_NUMBERS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "Z": 0}  # of commands


class Polyline(NamedTuple):
    """A path: straight from point to point.

    Attributes:
        points: Its corners, no two in a row the same, (m, 2) [m].
        length_m: How far along the path they are, (m,).
        headings: Heading asked for at each, without jumps by full turns, (m,); NaN where free.
    """

    points: Array
    length_m: Array
    headings: Array

    @classmethod
    def of(cls, rows: Sequence[Sequence[float]]) -> Polyline:
        """Path through points, x and y [m], and a heading [rad] where it is asked for."""
        given = np.array(rows, dtype=float)
        step = np.hypot(*np.diff(given[:, :2], axis=0).T)
        given = given[np.append(True, step > _SAME_M)]
        length_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(given[:, :2], axis=0).T)))
        free = np.full(len(given), np.nan)
        headings = np.unwrap(given[:, 2]) if given.shape[1] > 2 else free
        return cls(given[:, :2], length_m, headings)

    @property
    def tangent(self) -> Polyline:
        """The same with headings along it: at a corner midway between those of its pieces."""
        own = self.tangents
        midway = (own[:-1] + own[1:]) / 2
        return self._replace(headings=np.concatenate([own[:1], midway, own[-1:]]))

    @property
    def tangents(self) -> Array:
        """Heading of each piece, without jumps by full turns, (m - 1,) [rad]."""
        step = np.diff(self.points, axis=0)
        return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))

    def at(self, length_m: Array) -> Array:
        """Points so far along it, (k, 2) [m]."""
        both = (np.interp(length_m, self.length_m, each) for each in self.points.T)
        return np.column_stack([*both])

    def after(self, from_m: float) -> Polyline:
        """What is left of it after a length."""
        rows = np.column_stack([self.points, self.headings])
        first = [np.interp(from_m, self.length_m, each) for each in rows.T]
        left = rows[self.length_m > from_m + _SAME_M]
        return Polyline.of([first, *(left if len(left) else rows[-1:])])

    def along(self, points: Array, within_m: float) -> Array:
        """How far along it each of points (k, 2) is that follow it, (k,) [m].

        Never back; each is the nearest to its point of what is up to ``within_m`` further on than
        the one before.
        """
        found, here = np.zeros(len(points)), 0.0
        step, start = np.diff(self.points, axis=0), self.length_m[:-1]
        own = np.diff(self.length_m)
        for k, point in enumerate(points):
            first = max(int(np.searchsorted(self.length_m, here, side="right")) - 1, 0)
            last = max(int(np.searchsorted(self.length_m, here + within_m)), first + 1)
            piece = slice(min(first, len(own) - 1), last)
            low = np.maximum(here - start[piece], 0.0)
            high = np.minimum(here + within_m - start[piece], own[piece])
            by = point - self.points[:-1][piece]
            share = np.clip((by * step[piece]).sum(axis=1) / own[piece], low, high)
            off = by - share[:, None] * step[piece] / own[piece, None]
            nearest = int(np.hypot(*off.T).argmin())
            here = float(start[piece][nearest] + share[nearest])
            found[k] = here
        return found


def wrong_place(line: Polyline, most_turn_rad: float, within_m: float) -> tuple[int, str] | None:
    """Number of a point at which nothing can follow a path, and what would do; None: nowhere.

    Args:
        line: The path.
        most_turn_rad: How far it may turn at once.
        within_m: How far aside what follows it may be.
    """
    turns = np.abs(np.diff(line.tangents))
    turns = np.minimum(turns, math.tau - turns)
    if turns.max(initial=0.0) <= most_turn_rad:
        return None
    at, turn = int(turns.argmax()) + 1, float(turns.max())
    wrong, radius_m = "no cusp, at which it turns back", within_m  # round its tip
    if turn <= _CUSP_RAD:
        wrong = f"no corner, where it turns by {math.degrees(turn):z.0f} degrees at once"
        radius_m = within_m / (1 / math.cos(turn / 2) - 1)
    room = f"a bend of a radius up to {1e3 * radius_m:z.2g} mm, which keeps within the tolerance"
    return at, f'{wrong}: {room}; a task that ends here, and another; or heading = "free"'


def flattened(control: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Points of cubic Bezier curves, one after the other, by 3 k + 1 control points [m]."""
    given = np.array(control, dtype=float)
    found = [given[:1]]
    for k in range(0, len(given) - 1, 3):
        p = given[k : k + 4]
        bent = float(np.hypot(*np.diff(p, n=2, axis=0).T).max())
        count = max(2, math.ceil(math.sqrt(0.75 * bent / _SAGITTA_M)))
        t = np.linspace(0.0, 1.0, count + 1)[1:, None]
        s = 1 - t
        found.append(s**3 * p[0] + 3 * s * s * t * p[1] + 3 * s * t * t * p[2] + t**3 * p[3])
    return [(x, y) for x, y in np.concatenate(found).round(7).tolist()]


def read_path(path: str | Path) -> tuple[list[tuple[float, ...]], list[float]]:
    """Points of a path in a file, and their times [s] where they have some.

    Of a CSV file, rows of x and y [m], and of a heading [rad] where there is a third column, times
    aside: those are in a column named ``t_s``. Lines without numbers are skipped. Of an SVG file,
    its one path: a unit is 1 mm, and y points down.

    Raises:
        InputError: If the file cannot be read, or holds no path, or several.
    """
    text = read_text(Path(path), str(path))
    with reading(str(path), allowed="a path"):
        return (_svg(text), []) if Path(path).suffix.lower() == ".svg" else _csv(text)


def _csv(text: str) -> tuple[list[tuple[float, ...]], list[float]]:
    sign = next((each for each in ";\t," if each in text), " ")
    found, clock, times_s = list[tuple[float, ...]](), -1, list[float]()
    for number, row in enumerate(csv.reader(text.splitlines(), delimiter=sign), start=1):
        cells = [cell.strip() for cell in row if cell.strip()]
        clock = cells.index(_CLOCK) if not found and _CLOCK in cells else clock
        try:
            times_s += [float(cells.pop(clock))] if clock >= 0 else []
            found.append(tuple(map(float, cells[:3])))
        except (ValueError, IndexError):
            if found:
                allowed = f"two or three numbers{', and a time' * (clock >= 0)}"
                raise InputError(f"line {number}", sign.join(row), allowed) from None
    found = [row for row in found if row]
    if len({len(row) for row in found}) != 1 or len(found[0]) < 2:
        raise InputError("rows", len(found), "rows of x and y, or all with a heading")
    step = np.hypot(*np.diff(np.array(found)[:, :2], axis=0).T)
    far = int(step.argmax())
    if len(step) >= _MANY and step[far] > _JUMP * np.median(step):
        times = f"{step[far] / np.median(step):z.0f} times as far as others are apart"
        allowed = f"no jump: the next row is {1e3 * step[far]:z.0f} mm away, {times}"
        raise InputError(f"row {far + 1}", found[far], allowed)
    return found, times_s


def _svg(text: str) -> list[tuple[float, ...]]:
    paths = [each for each in ElementTree.fromstring(text).iter() if each.tag.endswith("path")]
    if len(paths) != 1:
        raise InputError("path", len(paths), "one path in the file")
    points = flattened([(_SVG_M * x, -_SVG_M * y) for x, y in _cubics(paths[0].get("d", ""))])
    return [(x, y) for x, y in points]


def _cubics(data: str) -> Iterator[tuple[float, float]]:
    """Control points of the cubic curves of SVG path data."""
    here = start = handle = 0j
    before = ""
    for command, numbers in _commands(data):
        kind = command.upper()
        by = here if command.islower() else 0j
        pairs = [complex(*pair) + by for pair in zip(numbers[::2], numbers[1::2], strict=False)]
        if kind == "H":
            pairs = [complex(numbers[0] + by.real, here.imag)]
        elif kind == "V":
            pairs = [complex(here.real, numbers[0] + by.imag)]
        elif kind == "Z":
            pairs = [start]
        if kind == "M":
            if before:
                jump = [f"({z.real:zg}, {z.imag:zg})" for z in (here, pairs[0])]
                allowed = f"a path without a jump: this one is from {jump[0]} to {jump[1]}"
                raise InputError("path", f"a second {command}", allowed)
            here = start = pairs[0]
            yield here.real, here.imag
        mirrored = 2 * here - handle if before in {"S": "CS", "T": "QT"}.get(kind, "") else here
        if kind in "CS":
            first, second = (mirrored, pairs[0]) if kind == "S" else (pairs[0], pairs[1])
            handle = second
        elif kind in "QT":
            handle = mirrored if kind == "T" else pairs[0]
            first, second = (here + 2 * handle) / 3, (pairs[-1] + 2 * handle) / 3
        else:
            first, second = (2 * here + pairs[-1]) / 3, (here + 2 * pairs[-1]) / 3
        if kind != "M":
            yield from ((each.real, each.imag) for each in (first, second, pairs[-1]))
        here, before = pairs[-1], kind


def _commands(data: str) -> Iterator[tuple[str, list[float]]]:
    """Commands of SVG path data, each with its numbers; one that is repeated may be left out."""
    signs = _SVG.findall(data)
    k, command = 0, ""
    while k < len(signs):
        if signs[k][0]:
            command, k = signs[k][0], k + 1
        count = _NUMBERS.get(command.upper())
        if count is None or (not count and k < len(signs) and signs[k][1]):
            raise InputError("path", command or data[:20], f"commands {' '.join(_NUMBERS)}")
        numbers = [float(number) for _, number in signs[k : k + count] if number]
        if len(numbers) < count:
            raise InputError("path", data[-20:], f"{count} numbers after each {command}")
        yield command, numbers
        k += count
        command = {"M": "L", "m": "l"}.get(command, command)
