"""Keys of the files: units and words for them, and what was meant by one that is nearly right."""

from __future__ import annotations

import difflib
import functools
import math
import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any


@functools.cache
def _tables() -> dict[str, Any]:
    """Tables of ``keys.toml``: keys, units and likely mistakes."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def unit_of(key: str) -> str:
    """Unit of a key by its ending; empty if it has none."""
    units: dict[str, str] = _tables()["units"]
    endings = (end for end in units if f"_{key}".endswith(end))
    return units.get(max(endings, key=len, default=""), "")


def stem_of(key: str) -> str:
    """Return a key without the ending that names its unit, also a unit that files do not use."""
    known = (*_tables()["units"], *_tables()["other_units"])
    endings = [end for end in known if key.endswith(end)]
    return key.removesuffix(max(endings, key=len)) if endings else key


def key_of(field: str) -> str:
    """Last key in the dotted name of a field; numbers of entries are none."""
    return next((part for part in reversed(field.split(".")) if not part.isdigit()), "")


def describe(key: str) -> str:
    """Say what a key is, with its unit in brackets where it has one."""
    words, unit = _tables()["words"].get(key), unit_of(key)
    if not unit:
        return words or key.replace("_", " ")
    return f"{words or stem_of(key).replace('_', ' ')} [{unit}]"


def plain_words(phrase: str) -> str:
    """Words of pydantic for what is allowed, in those of this package."""
    for words, plainer in _tables()["plainer"].items():
        phrase = phrase.replace(words, plainer)
    return phrase


_SHARE = "_percent"
_FREE = ("free", "any", "none", "null", "nan", "*", "-", "")
_NUMBER = re.compile(r"\s*([-+]?\d*[.,]?\d+(?:e[-+]?\d+)?)\s*([A-Za-z°/%1]*)\s*", re.IGNORECASE)
_TURNS = re.compile(r"\s*([-+]?)([\d.]*)\s*\*?\s*(?:\w+\.)?pi\s*(?:/\s*([\d.]+))?\s*")
_WRITTEN = {"%": "percent", "°": "deg", "1/mm": "per_mm", "1/m": "per_m"}


def near_word(word: object, words: Iterable[str]) -> str:
    """Ask for the nearest of some words; empty if there is none near."""
    asked, known = str(word).lower(), {each.lower(): each for each in words}
    close = [each for each in known if each.startswith(asked) and len(asked) > 2]
    close = close or difflib.get_close_matches(asked, known, n=1)
    return f"did you mean {known[close[0]]}?" if close else ""


def near_key(key: str, value: object, known: list[str]) -> str:
    """Ask for the key that was probably meant, with the value in its unit; empty if unknown."""
    stem, others = stem_of(key), _tables()["other_units"]
    same = [each for each in known if stem_of(each).lower() == stem.lower()]
    aliases = _tables()["aliases"]
    same += [each for each in known if stem in aliases.get(each, "").split()]
    same += [each for each in known if sorted(each.split("_")) == sorted(key.split("_"))]
    if not same and stem in ("radius", "radii") and "kappa_per_m" in known:
        return "did you mean kappa_per_m, one over the radius?"
    if not same:
        return near_word(key, known)
    ending = max((end for end in others if key.endswith(end)), key=len, default="")
    given = value if isinstance(value, list | tuple) else [value]
    numbers = [each for each in given if isinstance(each, int | float)]
    if not (ending and numbers and same[0].endswith(others[ending][0])):
        return f"did you mean {same[0]}?"
    meant = ", ".join(_converted(float(number), ending) for number in numbers)
    return f"did you mean {same[0]} = {meant if given == [value] else f'[{meant}]'}?"


def near_number(key: str, value: object, *, optional: bool, listed: bool) -> str:
    """Say what to write where a number should be and something else is; empty if unknown."""
    if isinstance(value, list | tuple) and len(value) == 1:
        return f"did you mean {value[0]!r}, without brackets?"
    if not isinstance(value, str):
        return ""
    if value.strip().lower() in _FREE:
        free = 'did you mean "free"?' if listed else "leave the key out where it is free."
        return free if optional else "this one cannot be free."
    if value.strip().lower() in ("soft", "rigid", "straight") and key.startswith("kappa"):
        return "a segment is straight at 0; modes say which are soft."
    if (turns := _TURNS.fullmatch(value)) is not None:
        radians = float(turns[2] or 1) * math.pi / float(turns[3] or 1)
        return f"did you mean {turns[1]}{radians:z.4g}, written out?"
    if (found := _NUMBER.fullmatch(value)) is None:
        return ""
    others = _tables()["other_units"]
    number, unit = float(found[1].replace(",", ".")), f"_{_WRITTEN.get(found[2], found[2])}"
    if unit in others and key.endswith(others[unit][0]):
        return f"did you mean {_converted(number, unit)}, a bare number?"
    if unit == _SHARE and _SHARES.search(key):
        return f"did you mean {number / 100:zg}, a bare number?"
    if found[2] and not key.endswith(unit):
        return "numbers have no unit."
    return f"did you mean {number:zg}, without quotes?"


def near_toml(text: str, error: str) -> str:
    """Say what is probably wrong with the line at which reading TOML ended; empty if unknown."""
    lines, place = text.splitlines(), re.search(r"line (\d+)", error)
    number = min(int(place[1]), len(lines)) if place else len(lines)
    line = lines[number - 1] if lines else ""
    if re.fullmatch(r"[^=\[\]#,;\t]+([,;\t][^=\[\]#,;\t]+)+", lines[0] if lines else ""):
        return "this looks like a table (CSV)."
    if re.match("Cannot (overwrite|declare)", error):
        return f"line {number} is {line.strip()[:40]!r}: that stands above already."
    looks = _tables()["lines"]
    hint = next((words for like, words in looks.items() if re.search(like, line)), "")
    return f"line {number} is {line.strip()[:40]!r}: {hint}" if hint else ""


_SHARES = re.compile(r"(^|\.)(gap|transition_quantile|fill|hold_duty)$")
_MINUTES = re.compile(r"^timing\..*\.(melt|freeze|heat|reconfigure)_s$|cooling_time_constant_s$")
_LEAST_S = 10.0  # no segment melts or freezes faster
_BENDS = re.compile(r"^(start|goal|tasks(\.goal)?)\.kappa_per_m$")
_PER_MM = (1e-3, 0.1)  # curvatures that a robot of this size has, in 1/mm


def other_unit(field: str, value: object) -> str:
    """Say what a number would be if it was given in another unit; empty if none is likely."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return ""
    name = ".".join(part for part in field.split(".") if not part.isdigit())
    for keys, ending, least in _tables()["slips"]:
        size = value if ending == _SHARE else abs(value)
        if size >= least and re.search(keys, name):
            return _meant(name, float(value), ending)
    quick = 0 < value < _LEAST_S and _MINUTES.search(name)
    return _meant(name, float(value), "_min") if quick else ""


def doubts(document: Any, name: str = "") -> Iterator[str]:
    """Yield a sentence on every legal number of a file that is probably in another unit."""
    if isinstance(document, dict):
        for key, value in document.items():
            if key == "phi_rad" and document.get("phi_modulo") is False:
                continue  # whole turns are meant
            yield from doubts(value, f"{name}.{key}" if name else key)
    elif isinstance(document, list | tuple):
        if _BENDS.search(name) and _are_per_mm(document):
            first = next(each for each in document if each)
            yield f"{name} = {list(document)}: {_meant(name, first, '_per_mm')}"
            return
        for item in document:
            yield from doubts(item, name)
    elif hint := other_unit(name, document):
        yield f"{name} = {document:zg}: {hint}"


def _are_per_mm(bends: list[Any] | tuple[Any, ...]) -> bool:
    """True if a person wrote these numbers, and means curvatures in 1/mm."""
    given = [each for each in bends if isinstance(each, int | float) and each != 0]
    least, most = _PER_MM
    return bool(given) and all(least <= abs(k) <= most and round(k, 4) == k for k in given)


def _meant(field: str, value: float, ending: str) -> str:
    if ending == _SHARE:
        return f"{value:zg} % are {value / 100:zg}: did you mean {value / 100:zg}?"
    given = {"_per_mm": "1/mm", "_mm_s": "mm/s", "_deg": "degrees", "_min": "minutes"}
    number, unit = _converted(value, ending), unit_of(field.rpartition(".")[2])
    return f"{value:zg} {given.get(ending, ending[1:])} are {number} {unit}: did you mean {number}?"


def _converted(value: float, ending: str) -> str:
    _, factor, added = _tables()["other_units"][ending]
    return f"{factor * value + added:z.4g}"
