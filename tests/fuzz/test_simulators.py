"""Simulators accept any bytes from a host and continue."""

from collections.abc import Callable
from random import Random
from typing import Any

from imuscope.protocols.isb.frames import DATA, NACK, get_data
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from tests.fuzz.mutations import spoil
from tests.fuzz.targets import TARGETS
from tests.protocols.isb import isb_vectors
from tests.protocols.xbus import xbus_vectors
from tests.support.each_row import each_row

MS = 1_000_000
AWAKE_NS = 600 * MS
PRODUCTS = ("MTi-630", "MTi-680G", "MTi-3", "MTi-G-710")
COMMANDS = {
    "xbus": [xbus_vectors.frame(v) for v in (*xbus_vectors.COMMANDS, *xbus_vectors.COMPUTED["messages"])],
    "isb": [isb_vectors.packet(v) for v in isb_vectors.COMMANDS],
}
SIMULATORS: dict[str, Callable[[int], Any]] = {
    "xbus": lambda seed: XbusSimulator(PRODUCTS[seed % len(PRODUCTS)], seed=seed),
    "isb": lambda seed: IsbSimulator(seed=seed),
}


@each_row("name", SIMULATORS)
def test_any_bytes_from_a_host(name: str) -> None:
    random = Random(7)
    for seed in range(40):
        simulator, now = SIMULATORS[name](seed), AWAKE_NS
        simulator.advance(now)
        simulator.receive(build(0x30), now)  # to an MTi: GoToConfig
        for _ in range(12):
            pieces = random.sample(COMMANDS[name], 2)
            spoil(pieces, TARGETS[name], random)
            now += 10 * MS
            simulator.receive(b"".join(pieces), now)
            assert isinstance(simulator.advance(now + 5 * MS), bytes)


def test_a_request_for_a_data_set_beyond_255_is_refused() -> None:
    """It ended the sim: a NACK has one byte for the number."""
    simulator = IsbSimulator()
    simulator.advance(AWAKE_NS)
    answer = simulator.receive(get_data(0x1D5, size=4), AWAKE_NS)
    assert answer[2] & 0xF in (NACK, DATA)
    assert bytes([0xEF, 0x49, NACK]) in answer


def test_an_invalid_date_is_refused() -> None:
    """Numpy took some for a time zone, with a warning."""
    for date in (b"\x07\xe5\x02\x1e\x00\x00\x00", b"\x07\xe5\x01\x01\xff\xff\xff", b"\x00\x00\x00\x00\x64\x64\x64"):
        simulator = XbusSimulator("MTi-680G")
        simulator.advance(AWAKE_NS)
        simulator.receive(build(0x30), AWAKE_NS)
        assert simulator.receive(build(0x60, b"\0\0\0\0" + date + b"\0"), AWAKE_NS + MS)[2] == 0x42
