"""Files that somebody has spoilt: bytes, tokens, values and structure, by a seeded generator."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_VALUES = [
    *(b"0", b"-0.0", b"-1", b"1e-300", b"1e155", b"1e308", b"-1e308", b"nan", b"inf", b"-inf"),
    *(b"9" * 5000, b"1e5000", b"150", b"48268", b"true", b'"x"', b"[]", b"{}", b"null", b"''"),
    *(b"0.1, 0.2", b'"$\\\\alpha_{"', b'"\\u0007\\u001b[31m"', b"[[[[1]]]]", b"1_000"),
]
_BYTES = [
    *(b"\x00", b"\xff", b"\xef\xbb\xbf", b"\x1b[2J", b"\r", b"\n\n"),
    *(b"=", b"[", b"]", b'"', b","),
]
Mutation = Callable[[random.Random, bytes], bytes]


def bytes_changed(rng: random.Random, text: bytes) -> bytes:
    """Put, drop or repeat a few bytes anywhere."""
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(text) + 1), rng.choice([0, 1, 1, 5, 50])
        more = rng.choice([b"", rng.choice(_BYTES), text[at : at + length] * rng.choice([2, 300])])
        text = text[:at] + more + text[at + length :]
    return text


def tokens_changed(rng: random.Random, text: bytes) -> bytes:
    """Swap, drop or repeat lines, or what stands between commas."""
    mark = rng.choice([b"\n", b"\n", b",", b" "])
    parts = text.split(mark)
    for _ in range(rng.randint(1, 3)):
        here, there = rng.randrange(len(parts)), rng.randrange(len(parts))
        match rng.randrange(4):
            case 0:
                parts[here], parts[there] = parts[there], parts[here]
            case 1 if len(parts) > 1:
                del parts[here]
            case 2:
                parts.insert(there, parts[here])
            case _:
                parts[here] = rng.choice(_VALUES)
    return mark.join(parts)


def values_changed(rng: random.Random, text: bytes) -> bytes:
    """Put other values where numbers are."""
    found = list(_NUMBER.finditer(text))
    for match in sorted(
        rng.sample(found, min(len(found), rng.randint(1, 3))), key=lambda m: -m.start()
    ):
        value = match.group()
        scaled = b"%g" % (float(value) * rng.choice([-1, 0.01, 0.5, 2, 10, 1e3, 1e6, 1e-6]))
        text = text[: match.start()] + rng.choice([scaled, scaled, *_VALUES]) + text[match.end() :]
    return text


def sizes_changed(rng: random.Random, text: bytes) -> bytes:
    """Make a few numbers larger or smaller, so that most files can still be read and used."""
    found = list(_NUMBER.finditer(text))
    for match in sorted(
        rng.sample(found, min(len(found), rng.randint(1, 3))), key=lambda m: -m.start()
    ):
        value = float(match.group()) * rng.choice([-1, 0, 0.1, 0.5, 0.9, 0.99, 1.01, 1.1, 2, 10])
        text = text[: match.start()] + b"%.12g" % value + text[match.end() :]
    return text


def structure_changed(rng: random.Random, text: bytes) -> bytes:
    """Cut the file off, nest or double it, or change the kind of something in a JSON document."""
    try:
        document = json.loads(text)
    except ValueError:
        document = None
    match rng.randrange(5):
        case 0:
            return text[: rng.randrange(len(text) + 1)]
        case 1:
            return text * 2
        case 2:
            return b"[" * 100_000 if rng.random() < 0.5 else b'{"a":' * 50_000
        case 3 if document is not None:
            return json.dumps(_another_kind(rng, document)).encode()
        case _:
            return b"\xef\xbb\xbf" + text


def _another_kind(rng: random.Random, value: object) -> object:
    """Replace something deep inside by something of another kind."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(sorted(value))
        return {**value, key: _another_kind(rng, value[key])}
    if isinstance(value, list) and value and rng.random() < 0.7:
        at = rng.randrange(len(value))
        return [*value[:at], _another_kind(rng, value[at]), *value[at + 1 :]]
    return rng.choice(
        [None, True, [], {}, "", "x" * 5000, -1, 1e300, 10**30, [value] * 3, {"a": value}]
    )


MUTATIONS: dict[str, Mutation] = {
    "bytes": bytes_changed,
    "tokens": tokens_changed,
    "values": values_changed,
    "sizes": sizes_changed,
    "structure": structure_changed,
}
