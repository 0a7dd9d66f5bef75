"""The tables of ISB agree with the vendor's header: its names and numbers are in golden/isb/vendor.json."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from imuscope.protocols.isb.dataset_loader import SOURCE, TABLES
from tests.vendor.constants import constants
from tests.vendor.inertial_sense import HEADERS, KEPT, MACROS, differences

SDK = os.environ.get("IMUSCOPE_INERTIAL_SENSE_SDK", "")


def test_every_bit_group_and_value_is_the_vendors() -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    assert kept["source"] == SOURCE
    newer = (
        "DID_IMUS ",
        "RMC_BITS_IMUS ",
        "RMC_BITS_GPX_SYS_FAULT ",
        "SYS_CMD_CLEAR_ERROR_STATUS ",
    )  # of 2026
    assert [line for line in differences(kept["constants"]) if not any(name in f"{line} " for name in newer)] == []


@pytest.mark.skipif(not SDK, reason="IMUSCOPE_INERTIAL_SENSE_SDK names no checked-out SDK")
def test_the_kept_constants_are_those_of_the_header() -> None:
    found = constants(HEADERS, [Path(SDK) / "src"], macros=MACROS)
    kept = json.loads(KEPT.read_text(encoding="utf-8"))["constants"]
    assert {name: found[name] for name in kept} == kept


def test_no_two_names_of_a_word_share_a_bit() -> None:
    """RMC options had a speed filter on the bits of the serial ports; sensorConfig a rotation within the gyro range."""
    for word, rows in TABLES.words.items():
        taken = 0
        for row in rows:
            bits = ((1 << row.width) - 1) << row.low
            assert not taken & bits, f"{word}: {row.name} overlaps"
            taken |= bits
