"""Comparison of the tables of ISB with the header of the vendor's SDK.

    python -m tests.vendor.inertial_sense SDK            every difference, one a line; exit status 1 if there is any
    python -m tests.vendor.inertial_sense SDK --write    the same; the constants stay in tests/golden/isb/vendor.json

SDK is a checked-out inertial-sense-sdk of the tag that tables.SOURCE names; gcc is needed. What is kept are names and
numbers, so that tests/protocols/isb/test_isb_vendor.py holds the tables to them without the SDK.

    datasets.txt                          data_sets.h
    words NAME PREFIX                     enum NAME, or macros that begin with PREFIX
      5     FLAG                          PREFIX FLAG == 1 << 5
      4:3   GROUP 1=ONE                   PREFIX GROUP _MASK == 7 << 4, or 7 with PREFIX GROUP _OFFSET == 4
                                          PREFIX GROUP _ONE == 1, or 1 << 4
    choices NAME PREFIX                   enum NAME; PREFIX MEMBER == VALUE
    struct NAME SIZE                      sizeof(NAME); offsetof of every field
    sets DID NAME                         macro NAME == DID

Both ways: what the table has must be in the header, and every constant of the header that is a bit or a value must be
in the table. Names that the vendor forms otherwise are rows of `MASKS`, `VALUES` and `STRUCTS`; constants that are no
bit and no value, of `APART`. A value of 0 may have a name of our own where the header has none.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from imuscope.protocols.isb.dataset_loader import SETS, SOURCE, TABLES
from imuscope.protocols.isb.streams import GPX_PRESETS, PRESETS
from imuscope.protocols.schema.fields import Bits
from tests.vendor.constants import Constants, constants, expressions

CONSTANTS_FILE = Path(__file__).parents[1] / "golden" / "isb" / "vendor.json"
HEADERS = ("data_sets.h", "ISComm.h")
MACROS = r"(RMC|GRMC|NMEA_RMC)_(BITS|OPTIONS|PRESET)_\w+|DID_[A-Z0-9_]+$"
WRAP = 1 << 64

MASKS: Mapping[str, str] = {
    "IO_CONFIG_GPS1_SOURCE": "IO_CONFIG_GPS_SOURCE_MASK",
    "IO_CONFIG_GPS2_SOURCE": "IO_CONFIG_GPS_SOURCE_MASK",
    "IO_CONFIG_GPS1_TYPE": "IO_CONFIG_GPS_TYPE_MASK",
    "IO_CONFIG_GPS2_TYPE": "IO_CONFIG_GPS_TYPE_MASK",
    "GPS_STATUS_FLAGS_GPS1_RTK_BASE": "GPS_STATUS_FLAGS_GPS1_RTK_BASE_POSITION_MASK",
    "GPX_GNSS_SAT_SIG_CONST_GLO": "GPX_GNSS_SAT_SIG_CONST_GLO",
}
"""The group as the table calls it → the constant that is its mask."""

VALUES: Mapping[str, str] = {
    "INFIELD_CAL_STATE_CMD": "INFIELD_CAL_STATE_",
    "INS_STATUS_GPS_NAV_FIX": "GPS_NAV_FIX_",
    "IO_CONFIG_GPS1_SOURCE": "IO_CONFIG_GPS_SOURCE_",
    "IO_CONFIG_GPS2_SOURCE": "IO_CONFIG_GPS_SOURCE_",
    "IO_CONFIG_GPS1_TYPE": "IO_CONFIG_GPS_TYPE_",
    "IO_CONFIG_GPS2_TYPE": "IO_CONFIG_GPS_TYPE_",
    "GPX_SYS_CFG_BITS_BOR_THRESHOLD": "GPX_SYS_CFG_BITS_BOR_",
    "SYS_CFG_BITS_BOR_THRESHOLD": "SYS_CFG_BITS_BOR_",
    "SYS_CFG_BITS_MAG_RECAL_MODE": "MAG_CAL_STATE_",
    "SAT_SV_STATUS_SIGNAL_QUALITY": "SAT_SIG_QUALITY_",
    "PORT_MON_PORT_TYPE": "PORT_MON_PORT_TYPE_",
}
"""The group as the table calls it → what its values begin with."""

STRUCTS: Mapping[str, str] = {"gpx_rmc_t": "rmc_t"}

APART = re.compile(
    r"""(.*(_OFFSET|_SHIFT|_BITMASK|_MASK|_COUNT|_BITSIZE|_LAST|_MAX|_Max|_END|_val|_offest)
    |(?!NMEA_MSG).*_DEFAULT(_INTEL)?|GNSS_SAT_SIG_CONST_ALL|GPX_GNSS_SAT_SIG_CONST_SBS_L1
    |.*MASK_(GENERAL|CRITICAL)_ERROR|G?RMC_OPTIONS_PORT_(ALL|CURRENT)|RMC_OPTIONS_NMEA_SPEED_FILTER_OFFSET
    |GPS_STATUS2_FLAGS_UNUSED|GPX_STATUS_FAULT_UNUSED|SYS_FAULT_STATUS_HARDWARE_RESET|IO_CFG2_G11_SWDIO)\Z""",
    re.VERBOSE,
)
"""Constants that are neither a bit nor a value: masks, places, counts, defaults, and what is unused."""

_OTHERWISE = (  # a constant, and its name in the table
    (re.compile(r"RUG3_IOEXP_BIT_OFFSET_(\w+)"), r"PLATFORM_CFG_RUG3_IOEXP_\1"),
    (re.compile(r"PLATFORM_CFG_RUG3_PRESET__0__PRESETS_DISABLED"), "PLATFORM_CFG_PRESET_DISABLED"),
)
_PIN = re.compile(r"(_\d+)+(?=_(?:S\d|CAN|SPI)|$)")


_NO_SETS = ("DID_COUNT", "DID_COUNT_UINS", "DID_MAX_COUNT", "DID_GPX_FIRST", "DID_EVENT_HEADER_SIZE")


def differences(vendor: Constants) -> list[str]:
    """Differences between the tables and the constants of the header."""
    return [*_words(vendor), *_enumerations(vendor), *_numbers(vendor["macros"])]


# -- flag words --------------------------------------------------------------------------------------------------------


def _words(vendor: Constants) -> Iterator[str]:
    everything = {name: value for members in vendor.values() for name, value in members.items()}
    for word, rows in TABLES.words.items():
        prefix = TABLES.prefixes[word]
        pool = vendor.get(word) or {name: v for name, v in vendor["macros"].items() if name.startswith(prefix)}
        pool = {_called(name): _bit(name, value) for name, value in pool.items()}
        if not pool:
            yield f"{word}: the header has no such enumeration"
        named: set[str] = set()
        for row in rows:
            yield from _of_row(word, row, {**everything, **pool}, named)
        if word == "eInfieldCalStatus":  # one axis in the header, three in the table
            named |= {f"INFIELD_CAL_STATUS_{row.name[2:]}" for row in rows if row.low < 18}
        bits = {1 << row.low for row in rows if row.width == 1}
        for name, value in pool.items():
            if name not in named and not APART.match(name) and not _combined(value, bits):
                yield f"{word}: the table lacks {name} = {_hex(value)}"


def _called(name: str) -> str:
    for pattern, text in _OTHERWISE:
        name = pattern.sub(text, name)
    if name.startswith("PLATFORM_CFG_RUG3_PRESET__") and name[26].isdigit():  # ..__1__S0_RS232_7_9___CAN_11_12__S1_GPS1
        number, _, rest = name[26:].partition("__")
        parts = [part for part in re.sub(r"_{2,}", " ", rest).split() if part]
        return f"PLATFORM_CFG_PRESET_RUG3_{number}_" + "_".join(_PIN.sub("", part.strip("_")) for part in parts)
    return name


def _bit(name: str, value: int) -> int:
    return 1 << 16 + value if name.startswith("RUG3_IOEXP_BIT_OFFSET_") else value


def _combined(value: int, bits: set[int]) -> bool:
    """Is it several flags that the table has one by one (or none, what a build leaves out)?"""
    left = value % WRAP
    for bit in bits:
        left &= ~bit
    return not left and value % WRAP not in bits


def _of_row(word: str, row: Bits, pool: Mapping[str, int], named: set[str]) -> Iterator[str]:
    """One flag or one group; `row.doc` is its constant."""
    if row.width == 1 and not row.choices:
        named.add(row.doc)
        value = pool.get(row.doc)
        if word == "eInfieldCalStatus" and row.low < 18:
            one = pool[f"INFIELD_CAL_STATUS_{row.name[2:]}"]
            value = one << pool[f"INFIELD_CAL_STATUS_SAMPLE_{row.name[0]}_OFFSET"]
        if value is None or value % WRAP & (WRAP - 1 if value > 0 or row.low > 31 else 0xFFFFFFFF) != 1 << row.low:
            yield f"{word} bit {row.low} {row.name}: {row.doc} is {_hex(value)}"
        if value is not None and (group := _group_of(row.doc, pool)):
            yield f"{word} bit {row.low} {row.name}: {row.doc} is a value of {group}, and no flag"
        return
    yield from _of_group(word, row, pool, named)


def _group_of(constant: str, pool: Mapping[str, int]) -> str:
    """The group of several bits that has this constant as a value; "" for a flag.

    A rotation of 8 resembles the flag of bit 3, and a level of 2 that of bit 1, so both could be listed.
    """
    for name, low in pool.items():
        group = re.sub(r"_(OFFSET|SHIFT)\Z", "", name)
        if group != name and constant.startswith(VALUES.get(group, f"{group}_")) and pool[constant] < 1 << low:
            return group
    return ""


def _of_group(word: str, row: Bits, pool: Mapping[str, int], named: set[str]) -> Iterator[str]:
    most = (1 << row.width) - 1
    masks = [MASKS.get(row.doc, ""), row.doc + "_MASK", row.doc + "_BITMASK", row.doc]
    low = next((pool[row.doc + end] for end in ("_OFFSET", "_SHIFT") if row.doc + end in pool), row.low)
    results = {pool[mask] & 0xFFFFFFFF for mask in masks if mask in pool}
    named.update(masks)
    ours = most << row.low
    if low != row.low or not (results & {most, ours} or word == "ePortMonPortType"):
        report = ", ".join(map(hex, sorted(results))) or "no mask"
        yield f"{word} bits {row.low}:{row.width} {row.name}: {report}, from bit {low}"
    start = VALUES.get(row.doc, row.doc + "_")
    for value, meaning in row.choices.items():
        constant = start + meaning
        named.add(constant)
        bits = {value, value << row.low}
        if constant in pool and pool[constant] & 0xFFFFFFFF not in bits:
            yield f"{word} {row.name}={meaning}: {constant} is {_hex(pool[constant])}, not {value}"
        elif constant not in pool and value and not (value == most and pool.get(row.doc) == ours):
            yield f"{word} {row.name}={meaning}: no {constant}"


# -- enumerations, numbers, places -------------------------------------------------------------------------------------


def _enumerations(vendor: Constants) -> Iterator[str]:
    for name, choices in TABLES.choices.items():
        if name not in TABLES.prefixes:
            continue  # meanings that the header gives in words only
        pool, prefix = vendor.get(name, {}), TABLES.prefixes[name]
        named = set()
        for value, meaning in choices.items():
            for one in meaning.split("/"):
                named.add(prefix + one)
                if pool.get(prefix + one) != value:
                    yield f"{name} {value} {one}: {prefix + one} is {pool.get(prefix + one)}"
        values = {pool[one] for one in named if one in pool}
        for constant, value in pool.items():
            alias = value in values and re.search(r"_(0|UNKNOWN|E1BC|E5a|E5|B2|L2|L5)\Z", constant)
            if constant not in named and not alias and not APART.match(constant):
                yield f"{name}: the table lacks {constant} = {value}"


def _numbers(macros: Mapping[str, int]) -> Iterator[str]:
    """Numbers of data sets, and presets."""
    for did, row in SETS.items():
        if macros.get(row.name) != did:
            yield f"{row.name} is {did}; the header says {macros.get(row.name)}"
    for name, did in macros.items():
        if name.startswith("DID_") and name not in _NO_SETS and did not in SETS:
            yield f"there is no data set {name} = {did}"
    presets = {f"RMC_PRESET_{name}": bits for name, bits in PRESETS.items()}
    presets |= {f"GRMC_PRESET_{name}": bits for name, bits in GPX_PRESETS.items()}
    for name, bits in presets.items():
        if macros.get(name, -1) % WRAP != bits:
            yield f"{name} is {bits:#x}; the header says {_hex(macros.get(name))}"
    for name, value in macros.items():
        if "_PRESET_" in name and name not in presets and not re.search(r"_(MS|MULT)\Z", name):
            yield f"there is no preset {name} = {_hex(value)}"


def _hex(value: int | None) -> str:
    return "missing" if value is None else f"{value % WRAP:#x}"


def _places(sdk: Path) -> Iterator[str]:
    """Sizes of structures and places of their fields."""
    request: dict[str, str] = {}
    expected: dict[str, int] = {}
    for name, struct in TABLES.structs.items():
        base = _path(name)
        request[name], expected[name] = f"sizeof({base})", struct.size
        for field, at in struct.places:
            key = f"{name}:{field.name}"
            request[key], expected[key] = f"(char*)&({base}.{field.name}) - (char*)&({base})", at
    report = expressions(request, HEADERS, [sdk / "src"])
    for key, value in expected.items():
        if report[key] != value:
            yield f"{key} is {value}; the header says {report[key]}"


def _path(name: str) -> str:
    """A C structure: an unnamed element is the first element of a list in another."""
    whole, *parts = name.split(".")
    text, so_far = f"(*({STRUCTS.get(whole, whole)}*)0)", whole
    for part in parts:
        so_far += f".{part}"
        text += f".{part}" + "[0]" * (so_far in TABLES.structs)
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sdk", type=Path, help="a checked-out inertial-sense-sdk")
    parser.add_argument("--write", action="store_true", help=f"keep names and numbers in {CONSTANTS_FILE.name}")
    options = parser.parse_args()
    path = constants(HEADERS, [options.sdk / "src"], macros=MACROS)
    lines = [*differences(path), *_places(options.sdk)]
    print("\n".join(lines) or "no difference")
    if options.write:
        used = {*TABLES.words, *TABLES.choices, "eGpsNavFixStatus", "baud_rate_t", "can_baudrate_t", "macros"}
        entries = {name: members for name, members in sorted(path.items()) if name in used}
        CONSTANTS_FILE.write_text(
            json.dumps({"source": SOURCE, "constants": entries}, indent=0) + "\n", encoding="utf-8"
        )
    return bool(lines)


if __name__ == "__main__":
    raise SystemExit(main())
