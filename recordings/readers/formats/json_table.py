"""JSON text with samples, as phones, web pages and scripts write it: each list of samples becomes a table.

{"time": 1.00, "gyro": [0.1, 0.2, 0.3]}                      lines of objects (JSON lines, NDJSON)
[{"timestamp": …, "accel_x": 0.7}, …]                        a list of objects, also as a member of an object
{"accel": {"t": [0, 0.01], "x": [1, 2]}}                     columns
{"interval_ms": 10, "sensors": [{"name": …}], "values": […]} rows of numbers, with their names and rate beside them

Members of an object in a sample become columns: value.x, values[0]. A text that names the sensor or device divides the
samples into tables. A file that ends too soon is read up to there.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.compressed import temporary_source
from imuscope.recordings.readers.formats.decompressing import UnpackedFolder
from imuscope.recordings.readers.formats.typed_rows import KEY, TypedTables, csv_line
from imuscope.recordings.readers.registry import HEAD_BYTES, FileReader, OpenRequest, register_reader
from imuscope.recordings.sources import FileDamage
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.clocks.names import JSON_NAMES, JSON_RATES, TIME, TIMES, words_of
from imuscope.recordings.tables.dates import is_moment
from imuscope.recordings.tables.format import LONGEST_LINE, MAX_COLUMNS, is_number

if TYPE_CHECKING:
    from imuscope.recordings.sources import Source

MAX_VALUE_BYTES = 64 << 20  # bytes of a file that is one value, which is read as a whole
MAX_DEPTH = 32  # brackets in brackets
MIN_ROWS = 2  # samples
MOST_CELLS = 64  # of a list in a sample
UNITS = ("unit", "units", "SIUN")
INDEX = "index"
HINT = "Give its samples as a list of objects, as JSON lines, or as a CSV file with a row for each."
_HEAD = re.compile(r'\s*(?:\{\s*["}]|\[\s*(?:\{\s*["}]|\[\s*[\[\]{"\d-]|-?\d[\d.eE+-]*\s*,))')
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}]', re.DOTALL)
_NUMBERS = re.compile(r"\s*\[([-+\d.eE,\s]+)\]\s*")  # an array of NumPy as text
_INDEX = re.compile(r"(.+)\[([012])\]")
_ORDER = re.compile(r"\(([xyz]), ?([xyz]), ?([xyz])\)")
_CLOSING = {"[": "]", "{": "}"}

Sample = dict[str, Any]
Table = tuple[str, Mapping[str, Any]]  # its name, and single values beside it


def is_json(head: bytes) -> bool:
    """Whether these are the first bytes of a JSON text: an object, or a list of lists, objects or numbers."""
    return _HEAD.match(head.decode("utf-8-sig", "replace")) is not None


def _open_json(request: OpenRequest) -> "Source":
    path = request.path
    unpacked, damage = UnpackedFolder(path), list[FileDamage]()
    source = temporary_source(unpacked, request, lambda: _written(path, unpacked, damage))
    source.damage[:0] = damage
    return source


def _written(path: Path, unpacked: UnpackedFolder, damage: list[FileDamage]) -> list[Path]:
    """A file of each table, with the columns of all its samples."""
    lines = _has_lines(path)
    value = None if lines else _whole(path, damage)

    def samples() -> Iterator[tuple[Table, Sample]]:
        return _of_lines(path, damage) if lines else _samples(value, path.stem, {})

    columns: dict[str, dict[str, str]] = {}  # table → column → unit
    heads: dict[str, Mapping[str, Any]] = {}
    for (name, beside), sample in samples():
        one = columns.setdefault(name, {})
        heads[name] = beside
        for key, cell in sample.items():
            is_unit = key in UNITS and isinstance(cell, str)
            if len(one) < MAX_COLUMNS and cell is not None and not is_unit:
                one.setdefault(key, (_unit(sample) or _unit(beside)) if key.startswith("value") else "")
    damage[:] = list(dict.fromkeys(damage))
    tables = TypedTables(path, unpacked)
    for (name, _), sample in samples():
        names = columns[name]
        titles = {key: _by_axis(key, heads[name]) for key in names}
        heading = csv_line([f"{titles[key]} ({unit})" if unit else titles[key] for key, unit in names.items()])
        tables.add(name, csv_line([_cell(sample.get(key)) for key in names]), _comments(heads[name]) + heading)
    damage[:] = list(dict.fromkeys(damage))
    files = tables.files()
    if not files:
        raise RecordingError(f"{path.name} is a JSON text without a list of samples.", HINT)
    return files


# -- text to values ----------------------------------------------------------------------------------------------------


def _has_lines(path: Path) -> bool:
    """Whether each line is a value of its own."""
    with _text_of(path) as file:
        filled = (line for line in iter(lambda: file.readline(LONGEST_LINE), "") if line.strip())
        lines = [line for _, line in zip(range(MIN_ROWS), filled, strict=False)]
    return (
        len(lines) == MIN_ROWS
        and all(is_json(line[:HEAD_BYTES].encode()) for line in lines)
        and _loads(lines[0]) is not None
    )


def _text_of(path: Path) -> TextIOWrapper:
    return TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace")


def _loads(text: str) -> Any:
    """The value of a text; None if it is not one, or nested too deeply."""
    try:
        return None if _depth(text) > MAX_DEPTH else json.loads(text)
    except ValueError:
        return None


def _depth(text: str) -> int:
    depth = deepest = 0
    for token in _TOKEN.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token[0], 0)
        deepest = max(deepest, depth)
    return deepest


def _whole(path: Path, damage: list[FileDamage]) -> Any:
    """The value of a file that is one; cut behind its last complete sample if it does not end."""
    if path.stat().st_size > MAX_VALUE_BYTES:
        raise RecordingError(
            f"{path.name} is one JSON value of more than {MAX_VALUE_BYTES >> 20} MB.", "Write it as JSON lines."
        )
    with _text_of(path) as file:
        text = file.read()
    if _depth(text) > MAX_DEPTH:
        raise RecordingError(f"{path.name} is JSON with more than {MAX_DEPTH} brackets in brackets.", HINT)
    try:
        return json.loads(text)
    except ValueError as error:
        words = str(error)
    closed = _closed(text)
    value = _loads(closed)
    if value is None:
        raise RecordingError(f"{path.name} is not JSON: {words[:100]}.", HINT)
    damage.append(
        FileDamage(len(closed), f"The text is damaged or ends too soon, and is read up to there: {words[:100]}.")
    )
    return value


def _closed(text: str) -> str:
    """The text up to the last place where a bracket closes inside of another, with the closing ones that lack."""
    brackets, end, lacking = "", 0, ""
    for token in _TOKEN.finditer(text):
        if token[0] in _CLOSING:
            brackets += token[0]
        elif token[0] in "]}":
            if not brackets or _CLOSING[brackets[-1]] != token[0]:
                break
            brackets = brackets[:-1]
            end, lacking = token.end(), "".join(_CLOSING[one] for one in reversed(brackets))
    return text[:end] + lacking


def _of_lines(path: Path, damage: list[FileDamage]) -> Iterator[tuple[Table, Sample]]:
    bad = 0
    with _text_of(path) as file:
        for line in iter(lambda: file.readline(LONGEST_LINE), ""):
            value = _loads(line) if line.strip() else {}
            bad += value is None
            if isinstance(value, dict) and value:
                yield from (((_name(value, path.stem), {}), _flat(one)) for one in _of_batch(value))
            elif isinstance(value, list):
                yield from [((path.stem, {}), _row(value, ()))] if _is_plain(value) else _samples(value, path.stem, {})
    if bad:
        damage.append(FileDamage(-1, f"Lines that are not JSON are left out: {bad}."))


# -- values to samples -------------------------------------------------------------------------------------------------


def _samples(value: Any, name: str, beside: Mapping[str, Any]) -> Iterator[tuple[Table, Sample]]:
    """The samples of all tables in a value.

    Args:
        name: of a table, if the samples name none.
        beside: members of the object that holds it.
    """
    if isinstance(value, list):
        names, index = _names(beside), _index(beside.get("index"), len(value))
        for one in value:
            if isinstance(one, dict) and (len(value) < MIN_ROWS or _holds_samples(one)):
                yield from _samples(one, "", one)
            elif len(value) < MIN_ROWS or _is_plain(value):
                break
            elif isinstance(one, dict):
                yield from (((_name(one, name), beside), _flat(inner)) for inner in _of_batch(one))
            elif isinstance(one, list):
                yield (name, beside), _row(one, names) | next(index, {})
    elif isinstance(value, dict):
        if _is_indexed(value) and all(isinstance(one, dict) for one in value.values()):  # a row for each
            rows = zip(value.values(), _index([*value], len(value)), strict=False)
            yield from (((_name(one, name), beside), _flat(one) | number) for one, number in rows)
            return
        if columns := _columns(value):
            for cells in zip(*columns.values(), strict=True):
                yield (name, value), dict(zip(columns, cells, strict=True))
            return
        held = [key for key, one in value.items() if isinstance(one, (list, dict))]
        tables = [key for key in held if key not in JSON_NAMES]
        for key in tables:
            yield from _samples(value[key], key if len(tables) > 1 or not name else name, value)


def _holds_samples(value: Mapping[str, Any]) -> bool:
    """Whether an object has a list of objects with times of their own."""
    lists = (of for of in value.values() if isinstance(of, list) and len(of) >= MIN_ROWS and isinstance(of[0], dict))
    return any(TIME.match(words_of(key)) or TIMES.match(words_of(key)) for of in lists for key in of[0])


def _of_batch(sample: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The samples of a packet: an object with lists of objects, all of one length, also in an object of it."""
    sizes = {*_packet_sizes(sample)}
    yield from [sample] if len(sizes) != 1 else (_member(sample, place) for place in range(sizes.pop()))


def _packet_sizes(value: Any) -> Iterator[int]:
    if isinstance(value, dict):
        for one in value.values():
            yield from _packet_sizes(one)
    elif isinstance(value, list) and value and not _is_plain(value):
        yield len(value)


def _member(value: Any, place: int) -> Any:
    """A packet with one sample of its lists."""
    if isinstance(value, dict):
        return {key: _member(one, place) for key, one in value.items()}
    return value[place] if isinstance(value, list) and value and not _is_plain(value) else value


def _is_plain(values: Sequence[Any]) -> bool:
    return not any(isinstance(one, (list, dict)) for one in values)


def _columns(value: Mapping[str, Any]) -> dict[str, Sequence[Any]]:
    """Members that are lists or objects of as many plain values as the first; empty if these are not two or more."""
    lists: dict[str, Any] = {key: list(one.values()) if _is_indexed(one) else one for key, one in value.items()}
    plain: dict[str, Sequence[Any]] = {
        key: one for key, one in lists.items() if isinstance(one, list) and len(one) >= MIN_ROWS and _is_plain(one)
    }
    size = max(map(len, plain.values()), default=0)
    columns = {key: one for key, one in plain.items() if len(one) == size and key not in JSON_NAMES}
    numbers = sum(all(map(_is_cell, one)) for one in columns.values())
    keys = [list(value[key]) for key in columns if _is_indexed(value[key])]
    if keys and INDEX not in columns and all(one == keys[0] for one in keys):
        cells = [row[INDEX] for row in _index(keys[0], size) if row]
        columns = {INDEX: cells, **columns} if cells else columns
    return columns if len(columns) >= MIN_ROWS and numbers else {}


def _is_indexed(value: Any) -> bool:
    """Whether an object counts its members, 0, 1, …, or has a time for each, as pandas writes a column."""
    if not isinstance(value, dict) or len(value) < MIN_ROWS:
        return False
    return all(map(str.isdecimal, value)) or all(map(is_moment, value))


def _index(cells: Any, count: int) -> Iterator[Sample]:
    """The cell of the index for each row; nothing in them where it only counts."""
    there = cells if isinstance(cells, list) and len(cells) == count and _is_plain(cells) else []
    counts = [str(one) for one in there] == [str(number) for number in range(count)]
    yield from ({INDEX: one} for one in there) if there and not counts else ({} for _ in range(count))


def _is_cell(value: Any) -> bool:
    return value is None or isinstance(value, (int, float)) or (isinstance(value, str) and is_number(value))


def _names(beside: Mapping[str, Any]) -> list[str]:
    """Names of the cells of a row, with their units, from a list beside the rows."""
    listed: Sequence[Any] = next((beside[key] for key in JSON_NAMES if isinstance(beside.get(key), list)), [])
    unit, names = _unit(beside), []
    for one in listed:
        name, its = (one.get("name"), _unit(one)) if isinstance(one, dict) else (one, unit)
        names.append(f"{name} ({its})" if its else str(name))
    return names


def _row(cells: Sequence[Any], names: Sequence[str]) -> Sample:
    """A row of numbers, also of a time and a list; the names are those of its last cells."""
    flat = [inner for one in cells for inner in (one if isinstance(one, list) else [one])][:MOST_CELLS]
    first = len(flat) - len(names)
    named = names if names and first in (0, 1) else ()
    return {(named[i - first] if named and i >= first else f"column {i + 1}"): one for i, one in enumerate(flat)}


def _name(sample: Mapping[str, Any], otherwise: str) -> str:
    """Name of the table of a sample: that of its sensor and device."""
    inner = [
        (f"{key}_{part}", text) for key, one in sample.items() if isinstance(one, dict) for part, text in one.items()
    ]
    named = [one for key, one in (*sample.items(), *inner) if isinstance(one, str) and KEY.match(words_of(key))]
    return " ".join(one[:40] for one in named if not is_number(one)) or otherwise


def _by_axis(key: str, beside: Mapping[str, Any]) -> str:
    """A column with the axis in place of its number, if a text beside the samples has the order: (z,x,y)."""
    index = _INDEX.fullmatch(key)
    order = next((one for text in beside.values() if isinstance(text, str) and (one := _ORDER.search(text))), None)
    is_axis = index is not None and order is not None and len({*order.groups()}) == len(order.groups())
    return f"{index[1]}.{order[int(index[2]) + 1]}" if is_axis and index is not None and order is not None else key


def _unit(sample: Mapping[str, Any]) -> str:
    return next((one[:20] for key in UNITS if isinstance(one := sample.get(key), str)), "")


def _flat(sample: Mapping[str, Any], prefix: str = "") -> Sample:
    """Columns of a sample: members of objects by a point, those of lists by their number."""
    out: Sample = {}
    for key, value in sample.items():
        name = f"{prefix}.{key}" if prefix and key else prefix or key
        if isinstance(value, str) and (listed := _NUMBERS.fullmatch(value)) is not None:
            value = re.split(r"[,\s]+", listed[1].strip(", \t\n"))
        if isinstance(value, dict):
            out |= _flat(value, name)
        elif isinstance(value, list):
            cells = value if len(value) <= MOST_CELLS and _is_plain(value) else []
            out |= {f"{name}[{i}]": one for i, one in enumerate(cells)}
        elif not (isinstance(value, str) and KEY.match(words_of(name))):
            out[name] = value
    return out


def _cell(value: Any) -> str:
    return "" if value is None else str(int(value)) if isinstance(value, bool) else str(value)


def _comments(beside: Mapping[str, Any]) -> str:
    """Single values beside a table, as comments above it: its rate, its start."""
    plain = {
        key: one for key, one in beside.items() if isinstance(one, (str, int, float)) and not isinstance(one, bool)
    }
    rates = {JSON_RATES.get(key, key): f"{one} ms" if key in JSON_RATES else one for key, one in plain.items()}
    return "".join(f"# {key}: {' '.join(str(one).split())[:200]}\n" for key, one in rates.items())


register_reader(FileReader("json", "JSON", (".json", ".jsonl", ".ndjson"), _open_json, order=90, recognises=is_json))
