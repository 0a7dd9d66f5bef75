"""Comparison of the tables of Xbus with the headers of the vendor's public library.

    python -m tests.vendor.xsens XSPUBLIC            every difference, one a line; exit status 1 if there is any
    python -m tests.vendor.xsens XSPUBLIC --write    the same; the constants stay in tests/golden/xbus/vendor.json

XSPUBLIC is the folder `xspublic` of the vendor's ROS driver; gcc is needed. What is kept are names and numbers, so that
tests/protocols/xbus/test_xbus_vendor.py holds the tables to them without it. Names differ between the document, which
the tables follow, and the headers: rows of the mappings below say which is which; a number without a mapping is
compared by its name.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from imuscope.protocols.schema.fields import Bits
from imuscope.protocols.xbus import data_identifiers, enums, messages
from tests.vendor.constants import Constants, constants

CONSTANTS_FILE = Path(__file__).parents[1] / "golden" / "xbus" / "vendor.json"
SOURCE = "Xsens_MTi_ROS_Driver_and_Ntrip_Client, lib/xspublic"
TYPES = (
    *("statusflag", "baudcode", "canbaudcode", "deviceoptionflag", "resultvalue", "dataidentifier", "xbusmessageid"),
    *("syncfunction", "syncpolarity", "stringoutputtype"),
)
CONTROLLER = ("subloxgnssplatform", "sicccommand", "serrormode", "sselftestresult", "salignmentframe")

STATUS: Mapping[str, str] = {
    "Selftest": "SelfTestOk",
    "FilterValid": "OrientationValid",
    "GnssFix": "GpsValid",
    "NoRotationUpdateStatus": "NoRotationMask",
    "ClockSync": "ExternalClockSynced",
    "ClippingIndication": "ClippingDetected",
    "SyncInMarker": "SyncIn",
    "SyncOutMarker": "SyncOut",
}
MIDS: Mapping[str, str] = {
    "ReqFWRev": "ReqFirmwareRevision",
    "FirmwareRev": "FirmwareRevision",
    "ReqSyncSettings": "ReqSyncConfiguration",
    "SetSyncSettings": "SetSyncConfiguration",
    "ReqSyncSettingsAck": "SyncConfiguration",
    "SetSyncSettingsAck": "SetSyncConfigurationAck",
    "ExtOutputMode": "ReqExtOutputModeAck",
    "GnssReceiverSettingsAck": "ReqGnssReceiverSettingsAck",
}
_RATE = re.compile(r"XBC_(\d+)(?:_(\d))?(k|MegaBaud)(\d?)")


def differences(vendor: Constants) -> list[str]:
    """Differences between the tables and the constants of the headers."""
    return [
        *_flags("status word", enums.STATUS_BITS, vendor["XsStatusFlag"], "XSF_", STATUS),
        *_flags("option flags", enums.OPTION_FLAGS, vendor["XsDeviceOptionFlag"], "XDOF_", {}),
        *_flags("string types", enums.STRING_TYPES, vendor["XsStringOutputType"], "XSOT_", {}),
        *_flags("self-test", enums.SELFTEST_BITS, vendor["XsSelfTestFlag"], "XSTF_", {}),
        *_rates(vendor["XsBaudCode"]),
        *_numbers("sync function", enums.SYNC_FUNCTIONS, vendor["XsSyncFunction"], ("Invalid", "Count")),
        *_numbers("platform", enums.GNSS_PLATFORMS, vendor["XsUbloxGnssPlatform"], ()),
        *_numbers("polarity", enums.POLARITIES, vendor["XsSyncPolarity"], ()),
        *_numbers("ICC command", enums.ICC_COMMANDS, vendor["XsIccCommand"], ()),
        *_numbers("error mode", enums.ERROR_MODES, vendor["XsErrorMode"], ("Invalid",)),
        *_numbers("device error", enums.DEVICE_ERRORS, vendor["XsDeviceErrorType"], ()),
        *_numbers("alignment", enums.ALIGNMENTS, vendor["XsAlignmentFrame"], ()),
        *_known("error code", (*enums.ERROR_CODES, *enums.WARNING_CODES), vendor["XsResultValue"]),
        *_known("data identifier", (row.id for row in data_identifiers.ITEMS), vendor["XsDataIdentifier"]),
        *_messages(vendor["XsXbusMessageId"]),
    ]


def _folded(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _flags(
    what: str, rows: Iterable[Bits], pool: Mapping[str, int], prefix: str, other: Mapping[str, str]
) -> Iterator[str]:
    """Flags and groups by name; a reserved one has no name in the header."""
    folded = {_folded(name.removeprefix(prefix)): value for name, value in pool.items()}
    for row in rows:
        mask = ((1 << row.width) - 1) << row.low
        value = folded.get(_folded(other.get(row.name, row.name)))
        if value != mask and not row.name.startswith("Reserved"):
            yield f"{what}: {row.name} is {mask:#x}; the header says {value if value is None else hex(value)}"


def _rates(pool: Mapping[str, int]) -> Iterator[str]:
    subjects: dict[int, int] = {}
    for name, code in pool.items():
        if hit := _RATE.match(name):
            whole, half, unit, tenth = hit.groups()
            thousand = 1_000_000 if unit == "MegaBaud" else 1000
            subjects[code] = int(whole) * thousand + int(half or tenth or 0) * thousand // 10
    for code, words in enums.BAUD_CODES.items():
        rate = re.sub(r"\D", "", words)
        if code != 0xFF and subjects.get(code) != int(rate):
            yield f"baud code {code:#x} is {words}; the header says {subjects.get(code)}"
    for code in subjects.keys() - enums.BAUD_CODES.keys():
        yield f"there is no baud code {code:#x}, {subjects[code]} Bd"


def _numbers(what: str, table: Mapping[int, str], pool: Mapping[str, int], apart: tuple[str, ...]) -> Iterator[str]:
    """The same numbers on both sides."""
    there = {value for name, value in pool.items() if name.rpartition("_")[2] not in apart}
    for number in sorted(table.keys() ^ there):
        yield f"{what} {number}: {'only in the table' if number in table else 'not in the table'}"


def _known(what: str, numbers: Iterable[int], pool: Mapping[str, int]) -> Iterator[str]:
    """Numbers that the header has as well."""
    there = set(pool.values())
    for number in numbers:
        if number not in there:
            yield f"{what} {number:#x} is not in the header"


def _messages(pool: Mapping[str, int]) -> Iterator[str]:
    folded = {_folded(name.removeprefix("XMID_")): value for name, value in pool.items()}
    for name, rows in messages.BY_NAME.items():
        if name.startswith("reserved "):
            continue
        value = folded.get(_folded(MIDS.get(name, name)))
        if value != rows[0].id:
            yield f"message {name} is {rows[0].id:#x}; the header says {value if value is None else hex(value)}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("xspublic", type=Path, help="the folder xspublic")
    parser.add_argument("--write", action="store_true", help=f"keep names and numbers in {CONSTANTS_FILE.name}")
    options = parser.parse_args()
    folders = [options.xspublic, options.xspublic / "xstypes", options.xspublic / "xscontroller"]
    headers = [*(f"xstypes/xs{name}.h" for name in TYPES), *(f"xscontroller/x{name}.h" for name in CONTROLLER)]
    results: Constants = {}
    for header in headers:  # one by one: two enumerations share names
        results |= constants([header], folders)
    lines = differences(results)
    print("\n".join(lines) or "no difference")
    if options.write:
        CONSTANTS_FILE.write_text(
            json.dumps({"source": SOURCE, "constants": results}, indent=0) + "\n", encoding="utf-8"
        )
    return bool(lines)


if __name__ == "__main__":
    raise SystemExit(main())
