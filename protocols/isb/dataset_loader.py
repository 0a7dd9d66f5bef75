"""Loader of datasets.txt: data sets, their fields, words and versions, as rows of the schema.

The file is the source: data sets, fields and flags are added there, in the form explained at its top, never here.
Reading it takes some 30 ms, once.

    words, choices  ─> Bits, {value: name}      struct ─> Struct: fields with their offsets
    titles, help    ─> Field.title if a struct gives none; Field.doc
    sets            ─> DataSet                  versions ─> structures by firmware

TOML would need its own rules for words, values, versions and units within its texts, as here, and be a fifth larger;
tomllib alone takes 56 ms for it, which would be added to each start.

Units: `unit=rad>°` means radians on the wire and degrees on display; CONVERSIONS has the factor. Columns keep radians.
The vendor's full constant of a flag (`INS_STATUS_NAV_MODE`) is its `doc`; its short name labels the lanes.
"""

import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

from imuscope.protocols.schema.fields import Bits, Field
from imuscope.protocols.schema.layouts import element

FILE = Path(__file__).with_name("datasets.txt")
SOURCE = "inertial-sense-sdk 2.7.1, data_sets.h"

CONVERSIONS = {
    ("rad", "°"): 180 / math.pi,
    ("rad/s", "°/s"): 180 / math.pi,
    ("rad/s/°C", "°/s/°C"): 180 / math.pi,
    ("s", "µs"): 1e6,
    ("0.1dBHz", "dBHz"): 0.1,
    ("0.25dBHz", "dBHz"): 0.25,
    ("0.004cycles", "cycles"): 0.004,
    ("0.01m", "m"): 0.01,
}
MARKS = {"!": "warning", "!!": "error"}
NUMBERS = {"u1": "u1", "i1": "i1", "char": "ascii", "bytes": "bytes"}

_ATTRIBUTE = re.compile(r'(\w+)=("[^"]*"|\S+)|\.(\d+)')


@dataclass(frozen=True, slots=True)
class Struct:
    """A packed structure.

    Args:
        size: bytes.
        places: (field, offset), in the vendor's order.
        counts: name of an array → name of the field with its number of used elements.
    """

    size: int
    places: tuple[tuple[Field, int], ...]
    counts: dict[str, str]

    def field(self, name: str) -> tuple[Field, int] | None:
        """A field by name, with its offset."""
        return next(((row, at) for row, at in self.places if row.name == name), None)


@dataclass(frozen=True, slots=True)
class DataSet:
    """One data set.

    Args:
        name, kind: as in the schema's Message.
        struct: None if the layout is not public.
        clock: the field that is the device clock ("week+timeOfWeek", "time", …); "" for none.
        rmc: the bit of DID_RMC that enables its broadcast; "" for none.
        sizes: firmware version → bytes, only for sets whose structure changed.
        changes: (version, fields that earlier firmware lacks or places differently), oldest first.
    """

    name: str
    struct: Struct | None
    kind: str
    clock: str
    rmc: str
    sizes: dict[str, int] = field(default_factory=dict)
    changes: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)


class DatasetTable:
    """The content of the file."""

    def __init__(self, text: str) -> None:
        self.words: dict[str, tuple[Bits, ...]] = {}
        self.choices: dict[str, dict[int, str]] = {}
        self.prefixes: dict[str, str] = {}  # of the vendor's constants, by word and enumeration
        self.titles: dict[str, str] = {}
        self.help: dict[tuple[str, str], tuple[str, str]] = {}  # structure and field → title ("" for none), sentence
        self.structs: dict[str, Struct] = {}
        self.sets: dict[int, DataSet] = {}
        self.versions: tuple[str, ...] = ()
        readers = {
            "words": self._read_words,
            "choices": self._read_choices,
            "meanings": self._read_meanings,
            "titles": self._read_titles,
            "help": self._read_help,
            "struct": self._read_struct,
            "sets": self._read_sets,
            "versions": self._read_versions,
        }
        for block in re.split(r"\n{2,}", re.sub(r"(?m)^#.*\n", "", text).strip()):
            head, *lines = block.splitlines()
            kind, *rest = head.split()
            readers[kind](rest, lines)

    def _read_words(self, head: list[str], lines: list[str]) -> None:
        name, prefix = head
        self.prefixes[name] = prefix
        self.words[name] = tuple(_bits(line.split(), prefix) for line in lines)

    def _read_choices(self, head: list[str], lines: list[str]) -> None:
        self.prefixes[head[0]] = head[1].strip("-")
        rows = (line.split() for line in lines)
        self.choices[head[0]] = {int(value): name for value, name in rows}

    def _read_meanings(self, head: list[str], lines: list[str]) -> None:
        rows = (line.split() for line in lines)
        self.choices[head[0]] = {int(value): name for value, name in rows}

    def _read_help(self, head: list[str], lines: list[str]) -> None:
        for line in lines:
            name, *title, text = (part.strip() for part in line.split("|"))
            self.help[head[0], name] = (title[0] if title else "", text)

    def _read_titles(self, head: list[str], lines: list[str]) -> None:
        self.titles = dict(line.split(maxsplit=1) for line in lines)

    def _read_struct(self, head: list[str], lines: list[str]) -> None:
        places: list[tuple[Field, int]] = []
        counts: dict[str, str] = {}
        for line in lines:
            offset, kind, name, *rest = line.split(maxsplit=3)
            attributes = {key or "decimals": (value or digits).strip('"') for key, value, digits in _attributes(rest)}
            title, text = self.help.get((head[0], name), ("", ""))
            places.append((self._field(kind, name, attributes, title, text), int(offset)))
            if "count" in attributes:
                counts[name] = attributes["count"]
        self.structs[head[0]] = Struct(int(head[1]), tuple(places), counts)

    def _field(self, kind: str, name: str, attributes: dict[str, str], title: str, doc: str) -> Field:
        base, *dims = kind.split("*")
        shape = tuple(int(n) for n in dims)
        title = title or attributes.get("title", self.titles.get(name, ""))
        if base in self.structs:
            fields = tuple(part for part, _ in self.structs[base].places)
            return Field(name, shape=shape, title=title, source=SOURCE, doc=doc, fields=fields)
        wire, _, shown = attributes.get("unit", "").partition(">")
        of = attributes.get("of", "")
        axes = tuple(attributes["axes"].split(",")) if "axes" in attributes else ()
        return Field(
            name,
            shape=shape,
            title=title,
            source=SOURCE,
            doc=doc,
            dtype=NUMBERS.get(base, f"<{base}"),
            unit=shown or wire,
            scale=CONVERSIONS[wire, shown] if shown else 1.0,
            sent_unit=wire if shown and wire.startswith("rad") else "",
            axes=axes,
            choices=self.choices.get(of, {}),
            bits=self.words.get(of, ()),
            decimals=int(attributes.get("decimals", -1)),
            period=_period(name, shown or wire, axes),
            frame=attributes.get("frame", ""),
            pad=0,
        )

    def _read_sets(self, head: list[str], lines: list[str]) -> None:
        for line in lines:
            did, name, struct, kind, clock, rmc = (word if word != "-" else "" for word in line.split())
            self.sets[int(did)] = DataSet(name, self.structs.get(struct), kind, clock, rmc)

    def _read_versions(self, head: list[str], lines: list[str]) -> None:
        self.versions = tuple(head)
        for line in lines:
            did, what, *rest = line.split()
            if what == "sizes":
                sizes = zip(head, rest, strict=True)
                self.sets[int(did)].sizes.update({version: int(size) for version, size in sizes if size != "-"})
            else:
                self.sets[int(did)].changes.append((what, tuple(rest)))


_WORDS = """
ACC accelerometer, BCAST broadcast, CAL calibration, CFG configuration, CMD command, CMP compassing, COEF coefficients,
COMM communication, COMP compensation, CONFIG configuration, DEV device, INFO information, MAG magnetometer,
MCAL motion calibrated, MISC details, MSG message, OBS observation, OPT options, PARAMS parameters, POS position,
RCVR receiver, REF reference, REL relative, SAT satellites, SC self-calibration, SCOMP sensor compensation, SIG signals,
SYS system, TCAL temperature calibrated, TEMP temperature, UCAL uncalibrated, UNCAL uncalibrated, VEL velocity
"""
_SHORT = dict(entry.split(maxsplit=1) for entry in _WORDS.strip().split(","))
_NAMES = re.compile(
    r"(INS|INL\d|IMU\d?|PIMU|GPS\d?|GNSS|GPX|RTK|RTOS|ROS|NED|EVB|ADC|TC|BIT|G?RMC|NMEA|CAN|HDW|NVR|LD|G\d|SN|\d+)\Z"
)


_TURNS = re.compile(r"(hdg|heading|azim|yaw)$", re.IGNORECASE)  # not their accuracies


def _period(name: str, unit: str, axes: tuple[str, ...]) -> float:
    """Period of an angle: that of a full circle for directions; 0 for angles that never wrap."""
    turns = axes[-1:] == ("yaw",) or _TURNS.search(name) is not None
    return 360.0 if unit == "°" and turns else 0.0


def title_of(name: str) -> str:
    """Display title of a data set: DID_GPS1_POS → "GPS1 position"."""
    words = name.removeprefix("DID_").split("_")
    text = " ".join(word if _NAMES.match(word) else _SHORT.get(word, word.lower()) for word in words)
    return text[:1].upper() + text[1:]


def as_written(row: Field) -> Field:
    """A field in the unit of the wire, in which it is entered, written and read back."""
    parts = tuple(as_written(part) for part in row.fields)
    if row.scale == 1:
        return replace(row, fields=parts) if parts else row
    units = (wire for (wire, shown), scale in CONVERSIONS.items() if (shown, scale) == (row.unit, row.scale))
    return replace(row, unit=next(units), scale=1.0, sent_unit="", decimals=-1, period=0.0)


def _attributes(rest: list[str]) -> list[tuple[str, str, str]]:
    return _ATTRIBUTE.findall(rest[0]) if rest else []


def _bits(words: list[str], prefix: str) -> Bits:
    """Parse `LOW[:WIDTH] NAME [@CONSTANT] [MARK] [VALUE=MEANING …]`."""
    low, _, width = words[0].partition(":")
    name, rest = words[1], words[2:]
    constant = next((word[1:] for word in rest if word.startswith("@")), prefix + name)
    mark = next((word for word in rest if word in MARKS or word == "+"), "")
    choices = {int(value): meaning for value, _, meaning in (word.partition("=") for word in rest if "=" in word)}
    severity = MARKS.get(mark, "")
    return Bits(name, int(low), int(width or 1), choices, severity, normal_set=mark == "+", doc=constant)  # type: ignore[arg-type]


def element_size(row: Field) -> int:
    """Bytes of one element of a field."""
    return int(element(row).itemsize)


TABLES = DatasetTable(FILE.read_text(encoding="utf-8"))
SETS = TABLES.sets
VERSIONS = TABLES.versions
CURRENT = VERSIONS[-2]  # the version of the structures in the file
