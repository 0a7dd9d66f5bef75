"""Supported devices, firmware and data sets of Inertial Sense, for the documentation."""

from __future__ import annotations

from collections.abc import Iterator

from imuscope.protocols.family.support_tables import SupportTable
from imuscope.protocols.isb.commands import COMMAND_ROWS
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS, VERSIONS, DataSet
from imuscope.protocols.isb.device_info import FAMILIES
from imuscope.protocols.isb.messages import ROWS
from imuscope.protocols.isb.stored_settings import STORED
from imuscope.protocols.isb.streams import STREAMS

RESERVED = ("DID_NULL", "DID_UNUSED")


def supported() -> Iterator[SupportTable]:
    """Families, firmware, data sets."""
    yield SupportTable(
        "Devices",
        "Read from `DID_DEV_INFO`; the page shows the hardware version after the name, as in IMX-5.0.4.",
        ("family", "hardware type"),
        tuple((name, str(number)) for number, name in FAMILIES.items()),
    )
    yield SupportTable(
        "Firmware",
        "The layout of every public data set is known for these versions. Payloads of other versions are decoded by "
        f"the layout of {CURRENT}, as far as the payload size allows.",
        ("version",),
        tuple((version,) for version in VERSIONS if version[0].isdigit()),
    )
    yield SupportTable(
        "Data sets",
        "Every data set can be read, and written where the device permits it. A setting is read, compared, written and "
        "restored on the Configure page. A data set without a public layout is shown as bytes. Together with the "
        f"commands of the device these are {len(COMMAND_ROWS)} commands.",
        ("DID", "name", "contents", "fields", "streams", "setting"),
        tuple(_row(number, dataset) for number, dataset in SETS.items() if not dataset.name.startswith(RESERVED)),
    )


def _row(number: int, dataset: DataSet) -> tuple[str, ...]:
    fields = str(len(dataset.struct.places)) if dataset.struct else "bytes"
    setting = "" if number not in STORED else "yes" if STORED[number].write else "read only"
    title = STORED[number].title if number in STORED else ROWS[number].title
    return (str(number), f"`{dataset.name}`", title, fields, "yes" if number in STREAMS else "", setting)
