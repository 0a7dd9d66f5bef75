"""The tables of ISB agree with the vendor's header: its names and numbers are in golden/isb/vendor.json."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from imuscope.protocols.isb.dataset_loader import SOURCE, TABLES
from tests.vendor.constants import constants
from tests.vendor.inertial_sense import CONSTANTS_FILE, HEADERS, MACROS, differences

SDK = os.environ.get("IMUSCOPE_INERTIAL_SENSE_SDK", "")


def test_every_bit_group_and_value_is_the_vendors() -> None:
    document = json.loads(CONSTANTS_FILE.read_text(encoding="utf-8"))
    assert document["source"] == SOURCE
    newer = (
        "DID_IMUS ",
        "RMC_BITS_IMUS ",
        "RMC_BITS_GPX_SYS_FAULT ",
        "SYS_CMD_CLEAR_ERROR_STATUS ",
    )  # of 2026
    assert [line for line in differences(document["constants"]) if not any(name in f"{line} " for name in newer)] == []


@pytest.mark.skipif(not SDK, reason="IMUSCOPE_INERTIAL_SENSE_SDK names no checked-out SDK")
def test_the_kept_constants_are_those_of_the_header() -> None:
    path = constants(HEADERS, [Path(SDK) / "src"], macros=MACROS)
    document = json.loads(CONSTANTS_FILE.read_text(encoding="utf-8"))["constants"]
    assert {name: path[name] for name in document} == document


def test_no_two_names_of_a_word_share_a_bit() -> None:
    """RMC options had a speed filter on the bits of the serial ports; sensorConfig a rotation within the gyro range."""
    for word, rows in TABLES.words.items():
        count = 0
        for row in rows:
            bits = ((1 << row.width) - 1) << row.low
            assert not count & bits, f"{word}: {row.name} overlaps"
            count |= bits
