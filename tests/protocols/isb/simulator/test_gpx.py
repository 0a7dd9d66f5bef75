"""Streams, bits, presets and configuration of a GPX."""

from __future__ import annotations

from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext, DeviceRejectedError
from imuscope.protocols.isb.commands import COMMAND_ROWS
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.family import SIMULATOR
from imuscope.protocols.isb.simulator.gpx import GpxSimulator
from imuscope.protocols.isb.streams import BY_GPX_BIT, GPX_PRESETS, OF_GPX, STREAMS, dids_of
from imuscope.server.configuration.form_builder import forms_of
from tests.support.transaction_player import PlayedWire, play

DRIVER = IsbDriver()
KNOWN = DeviceContext(product="GPX-1.0.3", firmware="2.7.1", baud=921_600)


def wire(**options: Any) -> PlayedWire:
    there = PlayedWire(GpxSimulator(**options), "isb", step_ns=5_000_000)
    there.pass_time(5)
    return there


def streams(there: PlayedWire) -> dict[int, int]:
    """Data set → period."""
    return {one["did"]: one["period"] for one in play(DRIVER.read("streams", KNOWN), there)["streams"]}


def test_it_is_a_gpx() -> None:
    assert play(DRIVER.identify(DeviceContext(baud=921_600)), wire()).product == "GPX-1.0.3"
    assert "GPX-1" in SIMULATOR.products()


def test_streams_of_a_gpx_are_read_and_written_without_an_imx_rmc() -> None:
    """Regression: the form requested DID_RMC only, which a GPX refuses."""
    there = wire()
    with pytest.raises(DeviceRejectedError):
        play(DRIVER.run("GET_DID_RMC", {}, KNOWN), there)
    assert streams(there) == {13: 1, 30: 1, 15: 5, 123: 500}
    expected = [{"did": 13, "period": 2}, {"did": 123, "period": 500}]
    written = play(DRIVER.write("streams", {"streams": expected, "options": 0}, KNOWN), there)
    assert written.refused == ""
    assert streams(there) == {13: 2, 123: 500}


def test_bits_of_its_own_choose_its_streams() -> None:
    there = wire()
    play(DRIVER.run("SET_DID_GPX_RMC", {"bits": 1 << 5 | 1 << 2, "options": 0}, KNOWN), there)
    assert set(streams(there)) == {13, 123}
    play(DRIVER.run("DID_GPX_RMC.GPX_GPS1", {"options": 0}, KNOWN), there)
    assert {13, 30, 15} <= set(streams(there))
    assert play(DRIVER.run("GET_DID_GPX_RMC", {}, KNOWN), there)["bits"] == 0x4E0  # it has no signals, no raw data


def test_every_bit_and_preset_names_data_sets() -> None:
    assert len(BY_GPX_BIT) == 26
    assert set(BY_GPX_BIT.values()) <= OF_GPX <= set(STREAMS)
    named = {SETS[did].name for did in dids_of(GPX_PRESETS["GPX_IMX"], gpx=True)}
    assert {"DID_GPX_STATUS", "DID_GPS1_POS", "DID_GPS2_VERSION", "DID_GPS2_RTK_CMP_REL"} <= named
    assert {f"DID_GPX_RMC.{name}" for name in GPX_PRESETS} <= set(COMMAND_ROWS)


def test_forms_of_a_gpx_offer_what_it_has() -> None:
    forms = forms_of(DRIVER, "isb", KNOWN)
    [table] = [form.table for form in forms.settings if form.table is not None]
    assert {row.id for row in table.rows} == OF_GPX
    assert BY_GPX_BIT[5] == 13
    names = {row.name for row in forms.commands}
    assert "DID_GPX_RMC.GPX_IMX" in names
    assert "DID_RMC.INS" not in names
    assert not {"DID_FLASH_CONFIG", "DID_EVB_FLASH_CFG"} & {row.name for row in forms.settings}


def test_its_configuration_is_kept_over_a_restart() -> None:
    there = wire()
    play(DRIVER.write("DID_GPX_FLASH_CFG", {"startupGPSDtMs": 400, "gnssSatSigConst": 0x33}, KNOWN), there)
    play(DRIVER.store_and_restart(KNOWN), there)
    there.pass_time(5)
    stored = play(DRIVER.read("DID_GPX_FLASH_CFG", KNOWN), there)
    assert (stored["startupGPSDtMs"], stored["gnssSatSigConst"]) == (400, 0x33)
    rows = play(DRIVER.read("streams", KNOWN), there)["streams"]
    assert next(one["source_ms"] for one in rows if one["did"] == 13) == 400


def test_sentences_of_the_receiver_only() -> None:
    there = wire()
    request = {"options": 0, "messages": [{"id": 7, "period": 5}, {"id": 4, "period": 1}]}  # GGA; PINS1 it has not
    play(DRIVER.run("ASCE", request, KNOWN), there)
    report = play(DRIVER.run("ASCE", {"options": 0, "messages": []}, KNOWN), there)
    assert (report["id_1"], report["period_1"], "id_2" in report) == (7, 5, False)
    there.pass_time(2)
