"""Products and data that are newer than the documents: with rules, or said to have none; never with false ones."""

from __future__ import annotations

import struct

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.events import Batch
from imuscope.protocols.isb.frames import DATA, build
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.output_configuration import OUTPUTS, max_rate
from imuscope.protocols.xbus.product_options import lines_of
from imuscope.protocols.xbus.products import MODELS, as_built, model_of
from imuscope.server.configuration.value_format import words
from tests.support.each_row import each_row


@each_row(
    ("product", "number", "name"),
    [
        ("MTi-610R-8A1G6", 610, "MTi-610R"),
        ("MTi-630R", 630, "MTi-630R"),
        ("MTi-670G-0I1G5", 670, "MTi-670G"),
        ("MTi-680G", 680, "MTi-680G"),
        ("MTi-8-0I-T", 0, ""),
        ("MTi-320-3A", 0, ""),
        ("AV01A1", 0, ""),
        ("SI30A1", 0, ""),
    ],
)
def test_a_product_has_rules_or_is_reported_to_have_none(product: str, number: int, name: str) -> None:
    model = model_of(product)
    assert (model.number, model.name) == (number, name) if model is not None else number == 0
    note = XbusDriver().lacking_rules(DeviceContext(product=product))
    assert note.startswith(f"No rules for {product}") == (number == 0)
    assert bool(note) == (number == 0)


def test_an_mti_670g_is_not_held_to_the_sync_lines_of_an_mti_670() -> None:
    own, plain = model_of("MTi-670G"), model_of("MTi-670")
    assert own is not None
    assert plain is not None
    assert set(lines_of(own)) > set(lines_of(plain))


@each_row(
    ("output", "hardware", "hertz"),
    [("BaroPressure", 1, 100), ("Temperature", 1, 400), ("RateOfTurnHR", 1, 1600), ("RateOfTurnHR", 2, 2000)],
)
def test_the_600_series_has_its_rates(output: str, hardware: int, hertz: int) -> None:
    model = as_built(MODELS[630], {"major": hardware, "minor": 0})
    assert max_rate(next(one for one in OUTPUTS.values() if one.name == output), model) == hertz


def test_bits_of_newer_firmware_are_named_or_numbered() -> None:
    driver = PROTOCOLS["isb"].configuration.driver
    assert driver is not None
    command = next(row for row in driver.commands(DeviceContext()) if row.name == "SET_DID_RMC")
    bits = command.arguments[0]
    text = words(bits, 1 << 8 | 1 << 49 | 1 << 53)
    assert text.lower().replace("_", " ") == "imus, gpx sys fault, unknown bit 53"
    assert "DID_SYS_CMD.CLEAR_ERROR_STATUS" in {row.name for row in driver.commands(DeviceContext())}


@each_row("did", [57, 96])
def test_all_five_imus_of_an_imx_6_are_decoded(did: int) -> None:
    """Its data set is 48 bytes longer, and lost all of its inertial sensors."""
    payload = struct.pack("<dI30f", 12.5, 0, *range(30))
    decoder = PROTOCOLS["isb"].decoding.decoder()
    decoder.feed(build(DATA, did, payload) * 2, 0)
    batches = [event for event in decoder.drain() if isinstance(event, Batch)]
    sensors = batches[0].columns["I"]
    assert sensors.shape == (2, 5)
    assert sensors[0]["acc"][4].tolist() == [27, 28, 29]
