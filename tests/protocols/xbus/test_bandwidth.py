"""The computed load of an output configuration is the measured one, to the byte. Held against captures and against the
simulator.
"""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.bandwidth import messages_of, size_of
from imuscope.protocols.xbus.output_configuration import (
    ALWAYS,
    OUTPUTS,
    SATELLITES,
    accepted_rates,
    allowed,
    max_rate,
    output_of,
    streams,
)
from imuscope.protocols.xbus.products import MODELS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.protocols.xbus.simulator.settings import PRODUCTS
from tests.protocols.xbus.xbus_values import DRIVER
from tests.support.each_row import each_row

S = 10**9
Pair = tuple[int, int]


def wished(pairs: list[Pair]) -> dict[str, Any]:
    entries = [{"data_identifier": identifier, "output_frequency": rate} for identifier, rate in pairs]
    return {"OutputConfiguration": {"outputs": entries}}


def load_of(pairs: list[Pair], product: str = "") -> float:
    return DRIVER.load(wished(pairs), DeviceContext(product=product)).total


def messages(data: bytes) -> list[tuple[bytes, tuple[Pair, ...]]]:
    """The MTData2 messages of a stream, with (identifier, size) of their items."""
    results = []
    at = 0
    while (at := data.find(b"\xfa\xff\x36", at)) >= 0:
        head = 6 if data[at + 3] == frames.EXTENDED else 4
        size = data[at + 3] if head == 4 else int.from_bytes(data[at + 4 : at + 6], "big")
        frame = data[at : at + head + size + 1]
        if len(frame) == head + size + 1 and not sum(frame[1:]) & 0xFF:
            results.append(
                (frame, tuple((identifier, size) for identifier, _, size in frames.items(frame[head:-1])[0]))
            )
            at += len(frame)
        else:
            at += 1
    return results


# -- captures ----------------------------------------------------------------------------------------------------------

FREE = 0x7020  # as long as the sky is full


def configured(always: str, fast: str, **others: str) -> list[Pair]:
    """Identifiers in the order of the message: those of every message, those at 100 Hz, those at other rates."""
    results = [(int(one, 16), ALWAYS) for one in always.split()] + [(int(one, 16), 100) for one in fast.split()]
    return results + [(int(one, 16), int(rate[3:])) for rate, names in others.items() for one in names.split()]


CONFIGURED = {  # output configuration of the captured devices, by the rates of their items
    "mti_100hz_49s": configured("1020 1060", "2010 4020 8020", hz_65535="E020", hz_4="7010"),
    "mti_float32": configured("1020 1060 1010 E020", "2030 4020 4010 8020 8030 5040 5020 D010", hz_4="7010"),
    "mti_float32_satinfo_ecef": configured(
        "1020 1060 1070 1010 E020", "2020 4030 2010 0810 5030 C020", hz_50="3010", hz_4="7010 7020"
    ),
}


@each_row("name", CONFIGURED)
def test_a_capture_is_as_long_as_its_configuration_states(captures: Path, name: str) -> None:
    """Message by message: the ones computed, less the items that a device leaves out while it has no value for them."""
    kinds = [due for stream in streams(CONFIGURED[name]) for due, _ in messages_of(stream)]
    results = messages(capture(captures, name))
    for frame, items in results:
        sizes = dict(items)
        timed = {identifier for identifier in sizes if (identifier, ALWAYS) not in CONFIGURED[name]}
        kind = min((kind for kind in kinds if timed <= {identifier for identifier, _ in kind}), key=len)
        assert all(identifier in sizes for identifier, rate in kind if rate == ALWAYS)
        there = [pair for pair in kind if pair[0] in sizes]
        assert [identifier for identifier, _ in there] == list(sizes)  # the order, too
        size = sum(3 + (sizes[FREE] if pair[0] == FREE else size_of(pair)) for pair in there)
        assert len(frame) == size + (5 if size <= 254 else 7)
    assert len(results) > 90


def capture(captures: Path, name: str) -> bytes:
    file = captures / "xbus" / f"{name}.bin"
    if not file.is_file():
        pytest.skip(f"no capture {file.name}")
    return file.read_bytes()


def test_a_capture_of_49_s_to_the_byte(captures: Path) -> None:
    """4 746 samples at 100 Hz and 190 solutions at 4 Hz, compared with the computed load of the same time."""
    results = messages(capture(captures, "mti_100hz_49s"))
    kinds = Counter(0x7010 in dict(items) for _, items in results)
    assert kinds == {False: 4746, True: 190}
    pairs = CONFIGURED["mti_100hz_49s"]
    main = load_of([pair for pair in pairs if pair[0] != 0x7010])
    solution = load_of(pairs) - main
    assert (main, solution) == (7300, 456)
    assert main * 4746 / 100 + solution * 190 / 4 == sum(len(frame) for frame, _ in results)


# -- the simulator -----------------------------------------------------------------------------------------------------


def measured(product: str, pairs: list[Pair], seconds: int) -> tuple[list[Pair], int]:
    """Configuration granted by a simulator, and the bytes that it sends in some seconds."""
    device = XbusSimulator(product, measuring=True)
    device.advance(S // 10)
    device.receive(frames.build(0x30), S // 10)
    answer = device.receive(frames.build(0xC0, b"".join(struct.pack(">HH", *pair) for pair in pairs)), S // 10)
    assert answer[2] == 0xC1, answer.hex()
    begin = S // 5
    device.receive(frames.build(0x10), begin)
    data = device.advance(begin + seconds * S - 1)
    head = 6 if answer[3] == frames.EXTENDED else 4
    return list(struct.iter_unpack(">HH", answer[head:-1])), len(data)


SKY = 15  # satellites that the simulator sees


@each_row("product", PRODUCTS)
def test_the_computed_load_is_that_of_the_simulators_outputs(product: str) -> None:
    pairs = list(PRODUCTS[product].output)
    pairs = [(identifier, 100 if rate < 0 else rate) for identifier, rate in pairs]
    used, length = measured(product, pairs, 1)
    shorter = sum(rate * 4 * (SATELLITES - SKY) for identifier, rate in used if identifier == FREE)
    assert length + shorter == load_of(pairs, product)


@st.composite
def configurations(draw: st.DrawFn) -> tuple[str, list[Pair]]:
    """A product and a list of outputs that it has, in any form and at any rate."""
    product = draw(st.sampled_from(sorted(PRODUCTS)))
    model = PRODUCTS[product].model
    forms = [i | p | c for i in OUTPUTS for p in range(4) for c in (0, 4, 8) if i != FREE]
    having = [identifier for identifier in forms if output_of(identifier, model)]
    chosen = draw(st.lists(st.sampled_from(having), max_size=12, unique_by=lambda identifier: identifier & 0xFFF0))
    rates = st.sampled_from([0, 1, 3, 4, 25, 50, 60, 100, 150, 200, 400, ALWAYS])
    return product, [(identifier, draw(rates)) for identifier in chosen]


@given(configurations())
def test_the_computed_load_is_the_sent_load_for_any_configuration(case: tuple[str, list[Pair]]) -> None:
    """A second of the simulator, compared with the load of the requested rates and of the reported rates."""
    product, pairs = case
    used, length = measured(product, pairs or [(0, 0)], 1)
    assert length == load_of(pairs, product) == load_of(used, product)


@given(configurations())
def test_parts_make_up_the_total_and_name_their_place(case: tuple[str, list[Pair]]) -> None:
    product, pairs = case
    load = DRIVER.load(wished(pairs), DeviceContext(product=product))
    assert [part.path for part in load.parts] == [*(f"outputs.{place}" for place in range(len(pairs))), ""]
    assert sum(part.bytes_per_s for part in load.parts) == load.total
    assert all(part.title for part in load.parts)


# -- rates that fit ----------------------------------------------------------------------------------------------------


@given(configurations(), st.floats(0.05, 1.2))
def test_fitted_rates_are_valid_and_within_the_capacity(case: tuple[str, list[Pair]], share: float) -> None:
    product, pairs = case
    model = PRODUCTS[product].model
    known = DeviceContext(product=product)
    capacity = share * load_of(pairs, product)
    fitted = DRIVER.fit_rates(wished(pairs), capacity, known)
    now = [(entry["data_identifier"], entry["output_frequency"]) for entry in fitted["OutputConfiguration"]["outputs"]]
    assert [identifier for identifier, _ in now] == [identifier for identifier, _ in pairs]
    for (identifier, before), (_, after) in zip(pairs, now, strict=True):
        output = output_of(identifier, model)
        assert output is not None
        most = max_rate(output, model)
        assert after == before or after in allowed(most)
        assert accepted_rates(after, most) <= accepted_rates(before, most)
    least = [(i, ALWAYS if max_rate(OUTPUTS[i & 0xFFF0], model) == ALWAYS else 1) for i, _ in pairs]
    assert DRIVER.load(fitted, known).total <= max(capacity, load_of(least, product))


def test_a_configuration_that_fits_is_unchanged() -> None:
    pairs = [(0x2010, 100), (0x4020, 400)]
    assert DRIVER.fit_rates(wished(pairs), 1e6, DeviceContext(product="MTi-630")) == wished(pairs)


def test_the_fastest_are_lowered_first() -> None:
    """Everything at 400 Hz on 115 200 Bd: fast outputs are reduced to a common rate, slow ones stay."""
    pairs = [(0x1020, ALWAYS), (0x2010, 400), (0x4020, 400), (0x8020, 400), (0xC020, 100), (0x3010, 50)]
    fitted = DRIVER.fit_rates(wished(pairs), 11_520, DeviceContext(product="MTi-630"))["OutputConfiguration"]["outputs"]
    assert [entry["output_frequency"] for entry in fitted] == [ALWAYS, 100, 100, 100, 100, 50]


# -- limits and sentences ----------------------------------------------------------------------------------------------


def test_exceeded_limits_are_reported() -> None:
    load = DRIVER.load(wished([(0x5031, 10)]), DeviceContext(product="MTi-680G"))
    assert any("fixed-point" in limit for limit in load.limits)
    load = DRIVER.load(wished([(0x4020, 1)] * 33), DeviceContext(product="MTi-680G"))
    assert any("32" in limit for limit in load.limits)
    assert DRIVER.load(wished([(0x4020, 400)]), DeviceContext(product="MTi-680G")).limits == ()


def test_sentences_replace_data() -> None:
    """600-series: the rate stands with the strings; before: 115200 / (period · (skip + 1)) lines a second."""
    outputs = wished([(0x2010, 400)])
    strings = {"StringOutputType": {"string_types": 1 << 8 | 1 << 3, "frequency": 10}}
    load = DRIVER.load({**outputs, **strings}, DeviceContext(product="MTi-630"))
    assert {part.title.split(",")[0] for part in load.parts} == {"HEHDT", "PHTRO"}
    assert load.total == 10 * (19 + 25)
    older = {
        "StringOutputType": {"string_types": 1 << 8},
        "Period": {"period": 1152},
        "OutputSkipFactor": {"skip_factor": 4},
    }
    assert DRIVER.load(older, DeviceContext(product="MTi-30")).total == 20 * 19
    silent = {**older, "OutputSkipFactor": {"skip_factor": 0xFFFF}}
    assert DRIVER.load(silent, DeviceContext(product="MTi-30")).total == 0


@each_row("number", MODELS)
def test_every_rate_of_a_product_is_granted_as_it_is(number: int) -> None:
    model = MODELS[number]
    for output in OUTPUTS.values():
        most = max_rate(output, model)
        assert all(accepted_rates(rate, most) == rate for rate in allowed(most))


@each_row(("hardware", "hertz"), [({}, 800), ({"major": 2, "minor": 0}, 800), ({"major": 1, "minor": 3}, 1000)])
@each_row("identifier", [0x4040, 0x8040])
def test_the_load_of_high_rate_items_is_that_of_the_hardware(
    identifier: int, hardware: dict[str, int], hertz: int
) -> None:
    """Hardware before 2.0 sends about 1000 Hz: a quarter more than the 800 Hz that were always counted."""
    outputs = {"outputs": [{"data_identifier": identifier, "output_frequency": 0xFFFF}]}
    settings = {"OutputConfiguration": outputs, "HardwareVersion": hardware}
    known = DeviceContext(product="MTi-3")
    assert DRIVER.load(settings, known).total == hertz * (4 + 3 + 12 + 1)
    chosen = DRIVER.fit_rates(settings, 0.6 * hertz * 20, known)["OutputConfiguration"]["outputs"]
    assert chosen[0]["output_frequency"] == hertz // 2
