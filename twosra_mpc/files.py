"""Reading user files with errors that name the place, and writing results atomically."""

from __future__ import annotations

import functools
import glob
import io
import itertools
import json
import math
import os
import stat
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twosra_mpc.errors import InputError
from twosra_mpc.keys import near_toml, near_word

if TYPE_CHECKING:
    from jinja2 import Environment

_PACKAGE = Path(__file__).parent
MOST_SIGNS = 200_000_000  # of a file that is read
_BLOCK = 2**20  # bytes that are asked for at once: as many are set aside
LARGEST = 1e12  # number in a table
_MOST_LINKS = 40  # from one to the next, as Linux follows them
_OUTPUTS: ContextVar[frozenset[str]] = ContextVar("outputs", default=frozenset())
_STREAMS = {  # names of what Python's own streams lead to
    **dict.fromkeys(("/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"), "stdout"),
    **dict.fromkeys(("/dev/stderr", "/dev/fd/2", "/proc/self/fd/2"), "stderr"),
}


def built_in_names(folder: str) -> list[str]:
    """Names of the TOML files in a data folder of the package."""
    return sorted(path.stem for path in (_PACKAGE / folder).glob("*.toml"))


def data_file(path: str) -> str:
    """Text of a file of the package, e.g. ``lab/report/page.css``."""
    return (_PACKAGE / path).read_text(encoding="utf-8")


@functools.cache
def environment(folder: str) -> Environment:
    """Templates of a folder of the package; what they are given is escaped, but in ``.txt``."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # takes 50 ms

    made = Environment(
        loader=PackageLoader("twosra_mpc", folder),
        autoescape=lambda name: name is None or not name.endswith(".txt"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["number"] = lambda value, form, sign="": format(value, f"{sign}z{form}")
    made.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return made


def locate(source: str | Path, folder: str, field: str) -> Path:
    """Find a built-in by name, or a user's file by path.

    Raises:
        InputError: If neither exists; the message lists the built-in names.
    """
    names = built_in_names(folder)
    if str(source) in names:
        return _PACKAGE / folder / f"{source}.toml"
    path = Path(source)
    if os.path.exists(path) and not os.path.isdir(path):  # a pipe is as good as a file
        return path
    hint = near_word(source, [*names, *_beside(path)])
    for other in {"robots", "scenarios"} - {folder}:
        if str(source) in built_in_names(other):
            hint = f"this is one of the {other}."
    hint = "this is a folder." if os.path.isdir(path) else hint
    hint = "this is text: tomllib.loads(text) has its keys." if "\n" in str(source) else hint
    allowed = f"a file that exists, or one of {', '.join(names)}"
    raise InputError(field, str(source), allowed, hint=hint)


def _beside(path: Path) -> list[str]:
    """Scenarios and robots in a folder, as a path into it would name them."""
    try:
        return [str(each) for end in ("toml", "json") for each in path.parent.glob(f"*.{end}")]
    except (OSError, ValueError):
        return []


@contextmanager
def outputs_are_no_inputs(outputs: Iterable[Path]) -> Iterator[None]:
    """Refuse to read, within the block, a file that will be written: it would be lost."""
    token = _OUTPUTS.set(frozenset(map(os.path.realpath, outputs)))
    try:
        yield
    finally:
        _OUTPUTS.reset(token)


def read_bytes(path: Path, source: str) -> bytes:
    """Read a file, a pipe or a device, once.

    Raises:
        InputError: If it cannot be read, is longer than ``MOST_SIGNS`` bytes, or is one of the
            outputs (`outputs_are_no_inputs`).
    """
    try:
        lost = os.path.realpath(path) in _OUTPUTS.get()
        with Path(os.devnull if lost else path).open("rb") as file:  # a device may never end
            blocks = iter(functools.partial(file.read, _BLOCK), b"")
            data = b"".join(itertools.islice(blocks, MOST_SIGNS // _BLOCK + 1))
    except (OSError, ValueError) as error:
        named = not os.path.exists(path) and source in built_in_names("scenarios")
        hint = f'"twosra plan {source} --out plan.json" writes its plan.' if named else ""
        reason = getattr(error, "strerror", None) or error
        exists = os.path.exists(path)
        allowed = f"a file that can be read ({reason})" if exists else "a file that exists"
        raise InputError("file", source, allowed, hint=hint) from error
    if lost:
        raise InputError("output", source, "another file than one that is read")
    if len(data) > MOST_SIGNS:
        raise InputError("file", source, f"at most {MOST_SIGNS} characters")
    return data


def text_of(data: bytes, source: str) -> str:
    """UTF-8 text, or UTF-16 that a byte order mark begins; lines may end as anywhere.

    Raises:
        InputError: If it is neither.
    """
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        return io.TextIOWrapper(io.BytesIO(data), encoding=encoding).read()
    except ValueError as error:
        raise InputError("file", source, f"UTF-8 text ({error})") from error


def read_text(path: Path, source: str) -> str:
    """Read a UTF-8 text file, as `read_bytes` and `text_of` do."""
    return text_of(read_bytes(path, source), source)


@contextmanager
def reading(
    source: str, what: str = "file", allowed: str = "values that fit together"
) -> Iterator[None]:
    """Name the file in whatever goes wrong while the block makes something of it.

    A file can be wrong in more ways than a reader knows of: numbers of 5000 digits, tables a
    thousand deep, matrices without an inverse.

    Args:
        source: The file.
        what: Field to name.
        allowed: What is allowed; what went wrong is added.

    Raises:
        InputError: In place of every exception.
    """
    try:
        yield
    except InputError as error:
        raise error.within("", source) from None
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
        raise InputError(what, source, f"{allowed} ({found})", source) from error


def read_document(path: Path, source: str) -> dict[str, Any]:
    """Read a TOML or JSON file into a dictionary.

    Raises:
        InputError: If the file cannot be read or parsed; the message carries line and column.
    """
    return document_in(read_text(path, source), path, source)


def document_in(text: str, path: Path, source: str) -> dict[str, Any]:
    """Read the text of a TOML or JSON file into a dictionary; JSON begins with a brace.

    Raises:
        InputError: If it cannot be parsed; the message carries line and column.
    """
    if path.suffix in (".json", ".geojson") or text.lstrip().startswith("{"):
        return json_document(text, source)
    return toml_document(text, source)


def toml_document(text: str, source: str) -> dict[str, Any]:
    """Read the text of a TOML file into a dictionary.

    Raises:
        InputError: If it cannot be parsed; the message carries line and column.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        hint = near_toml(text, str(error))
        raise InputError("file", source, f"valid TOML ({error})", hint=hint) from error


_KINDS = {  # kind of file -> keys that it has, and what takes it
    "plan": ({"phases", "samples"}, "twosra verify, report, animate, resample or export"),
    "run": ({"begun", "drives"}, "load_run of twosra_mpc.execution"),
    "GeoJSON": ({"coordinates", "features", "properties"}, "obstacles = of a scenario"),
    "robot": ({"geometry", "limits"}, "twosra check-robot, or --robot"),
    "batch": ({"grid", "random", "scenarios"}, "twosra batch"),
    "scenario": ({"start", "goal", "tasks"}, "twosra plan"),
}


def check_kind(document: Mapping[str, Any], wanted: str, source: str) -> None:
    """Refuse a file of another kind, before its keys are looked at.

    Args:
        document: What is in the file.
        wanted: Kind that is wanted.
        source: The file.

    Raises:
        InputError: If the file is empty, or is of another kind; the message says what takes it.
    """
    if not document and wanted in ("scenario", "robot"):
        hint = f'"twosra new {wanted} NAME" writes one to start from.'
        raise InputError("file", source, f"a {wanted}; this file is empty", hint=hint)
    found = (kind for kind, (keys, _) in _KINDS.items() if keys & document.keys())
    if (kind := next(found, wanted)) != wanted and not _KINDS[wanted][0] & document.keys():
        hint = f"this is a {kind} file, for {_KINDS[kind][1]}."
        raise InputError("file", source, f"a {wanted} file", hint=hint)


def json_document(text: str, source: str, allowed: str = "valid JSON") -> dict[str, Any]:
    """Read the text of a JSON file into a dictionary.

    Args:
        text: The text.
        source: The file.
        allowed: What is, for messages.

    Raises:
        InputError: If it cannot be parsed, is no table of keys, or has a key twice.
    """
    try:
        document = json.loads(text, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise InputError("file", source, f"{allowed} ({error})") from error
    if not isinstance(document, dict):
        raise InputError("file", source, "a table of keys at the top level")
    return document


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table whose keys are different."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r} is there twice")
    return table


def differences(before: Any, now: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield (dotted name, before, now) of every leaf in which two nested tables differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in {**now, **before}:
            inner = f"{name}.{key}" if name else key
            yield from differences(before.get(key), now.get(key), inner)
    elif before != now:
        yield name, before, now


def attributes(value: object, *names: str) -> dict[str, Any]:
    """Attributes of a value by their names: part of a document."""
    return {name: getattr(value, name) for name in names}


def check_writable(target: str | Path) -> None:
    """Refuse a path before an hour of planning is lost to it.

    Raises:
        InputError: If nothing can be written there.
    """
    if stream_of(target):
        return
    try:
        real = Path(os.path.realpath(target))  # what a link points to is written
        os.stat(real)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # its name is too long, or its links go round
        reason = getattr(error, "strerror", None) or error
        raise InputError("output", str(target), f"a path that leads to a file ({reason})") from None
    if real.is_dir():
        raise InputError("output", str(target), "the path of a file, not of a folder")
    special = is_device(target)
    written = target if special else real.parent
    if not ((special or os.path.isdir(written)) and os.access(written, os.W_OK)):
        raise InputError("output", str(target), "a path in a folder that exists and can be written")


def ending_of(target: str | Path, *allowed: str) -> str:
    """Ending of an output, which says its format; of a pipe or a device the first that is allowed.

    Raises:
        InputError: If it is none of those allowed.
    """
    if (ending := Path(target).suffix.lower()) in allowed:
        return ending
    if is_device(target) or stream_of(target):
        return allowed[0]
    raise InputError("output", str(target), f"a file ending in {' or '.join(allowed)}")


def is_device(target: str | Path) -> bool:
    """True if a path is a device or a pipe, which may be written to more than once."""
    return os.path.exists(target) and not os.path.isfile(target) and not os.path.isdir(target)


def stream_of(target: str | Path) -> str:
    """Name in ``sys`` of the stream that a path stands for, also by links; empty if none."""
    path = str(target)
    for _ in range(_MOST_LINKS):
        if path in _STREAMS or not os.path.islink(path):
            break
        path = os.path.join(os.path.dirname(path), os.readlink(path))
    return _STREAMS.get(path, "")


def write_bytes(target: str | Path, data: bytes) -> None:
    """Write a file as a whole or not at all; a device or a pipe is written to.

    What a link points to is replaced, and keeps its permissions.

    Raises:
        InputError: If it cannot be written, e.g. on a full disk.
        BrokenPipeError: If nobody reads the pipe.
    """
    check_writable(target)
    real = Path(os.path.realpath(target))
    try:
        if stream := stream_of(target):  # its descriptor may lead elsewhere by now
            getattr(sys, stream).flush()
            getattr(sys, stream).buffer.write(data)
            getattr(sys, stream).flush()
            return
        if is_device(target):
            with open(target, "wb") as file:
                file.write(data)
            return
        umask = os.umask(0)
        os.umask(umask)
        mode = stat.S_IMODE(real.stat().st_mode) if real.exists() else 0o666 & ~umask
        _replace(real, data, mode)
    except BrokenPipeError:
        raise
    except OSError as error:
        allowed = f"a path that takes {len(data)} bytes ({error.strerror})"
        raise InputError("output", str(target), allowed) from error


def _replace(real: Path, data: bytes, mode: int) -> None:
    """Put a new file in the place of another; where the system can, it has no name until then."""
    beside = real.with_name(f".{real.name[:200]}-{os.getpid()}")
    try:
        handle = os.open(real.parent, os.O_WRONLY | getattr(os, "O_TMPFILE", os.O_DIRECTORY), 0o600)
        unnamed = True
    except OSError:
        handle = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        unnamed = False
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(handle)
            os.chmod(handle if os.chmod in os.supports_fd else beside, mode)
            if unnamed:
                try:  # where nothing is to be replaced nothing else is ever seen
                    return _name(handle, real)
                except FileExistsError:
                    _clear(real)
                    _name(handle, beside)
        beside.replace(real)
    finally:
        beside.unlink(missing_ok=True)


def _clear(real: Path) -> None:
    """Remove what programs have left beside a file that were killed as they gave it its name."""
    for left in real.parent.glob(f".{glob.escape(real.name[:200])}-*"):
        number = left.name.rpartition("-")[2]
        if number.isdecimal() and not Path(f"/proc/{number}").exists():
            left.unlink(missing_ok=True)


def _name(handle: int, path: Path) -> None:
    """Give a file without a name one."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:  # only with a folder's descriptor the link behind /proc is followed
        os.link(f"/proc/self/fd/{handle}", path.name, dst_dir_fd=folder)
    finally:
        os.close(folder)


def write_json(target: str | Path, document: dict[str, Any]) -> None:
    """Write plain data as JSON, as a whole or not at all.

    Raises:
        InputError: If it ends in neither .json nor .geojson, or cannot be written.
    """
    ending_of(target, ".json", ".geojson")
    write_text(target, json.dumps(document, allow_nan=False) + "\n")


def write_text(target: str | Path, text: str) -> None:
    """Write a text file (UTF-8) as a whole or not at all.

    Raises:
        InputError: If it cannot be written.
    """
    write_bytes(target, text.encode())


def plain_data(value: Any) -> Any:
    """Turn a value into what JSON can hold: arrays to lists, NaN and infinities to None."""
    if hasattr(value, "tolist"):  # of NumPy, which commands that need no numbers do not load
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if is_dataclass(value):
        value = {item.name: getattr(value, item.name) for item in fields(value)}
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(item) for item in value]
    return value
