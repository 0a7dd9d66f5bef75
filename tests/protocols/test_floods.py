"""Linear decoding time for any bytes, including incomplete messages.

Compared is processor time of this thread, of one size and of sixteen times as much: linear work takes 16 times as long,
a search that starts over for each candidate 256 times. The limit is four times from either, which no noise reaches.
"""

import gc
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from imuscope.protocols.embedded import nmea
from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.registry import families as registry
from imuscope.protocols.xbus import binary_strings
from tests.support.each_row import each_row

SIZE = 2 * 1024
LARGER = {"longest ubx messages": 12 * 1024, "sentences and strings": 16 * 1024}  # than the longest; to be seen at all
TIMES = 16
MAX_GROWTH = 64.0  # times as long; 16 is linear, 256 is quadratic

TSS2 = b":12345 0123F 0456 -0789E\r\n"
EM1000 = bytes.fromhex("0090 1000 2000 0000 3000")
FLOODS = {
    "sentence heads": b"$GPGGA,",
    "starts of sentences": b"$",
    "sentences cut before their line end": b"$GPGGA,\r",
    "xbus preambles": b"\xfa",
    "longest xbus frames": bytes.fromhex("faff36ff0800"),
    "isb preambles": b"\xef\x49",
    "isb heads": bytes.fromhex("ef4904040007"),
    "idtp preambles": b"IDTP",
    "ubx preambles": b"\xb5\x62",
    "longest ubx messages": bytes.fromhex("b5620107ff1f"),
    "longest rtcm messages": bytes.fromhex("d303ff"),
    "rtcm heads": bytes.fromhex("d300"),
    "zeros": b"\0",
    "strings": TSS2 + EM1000,
    "sentences and strings": sentence("GPGGA,1") + TSS2 + EM1000,
}


@pytest.fixture(autouse=True)
def _without_collection() -> Iterator[None]:
    """Garbage collection visits all objects, which would add quadratic time of the test itself."""
    gc.disable()
    yield
    gc.enable()


def flood(piece: bytes, size: int) -> bytes:
    return (piece * (size // len(piece) + 1))[:size]


def growth(work: Callable[[bytes], object], piece: bytes, size: int) -> float:
    """Ratio of processor times for `TIMES` times as many bytes; measured again only if the first looks bad."""

    def cpu_s(data: bytes) -> float:
        began = time.thread_time()
        work(data)
        return time.thread_time() - began

    few, many = flood(piece, size), flood(piece, TIMES * size)
    cpu_s(few)
    ratios = (cpu_s(many) / max(max(cpu_s(few) for _ in range(2)), 1e-4) for _ in range(3))
    return next((ratio for ratio in ratios if ratio < MAX_GROWTH), MAX_GROWTH)


@each_row("name", FLOODS)
@each_row("protocol", registry.PROTOCOLS)
def test_decoding_a_flood_is_linear(protocol: str, name: str) -> None:
    def decode(data: bytes) -> None:
        decoder = registry.permissive_decoder(protocol)
        decoder.feed(data, 1)
        decoder.drain()
        decoder.drain(stalled=True)

    assert growth(decode, FLOODS[name], LARGER.get(name, SIZE)) < MAX_GROWTH


def test_sentence_starts_are_searched_in_linear_time() -> None:
    """20 MB of `$GPGGA,` took minutes, most of it copying the rest of the data to compare it with a carriage return."""
    assert growth(lambda data: nmea.find_nmea(data, final=False), b"$", 24 * 1024) < MAX_GROWTH


def test_records_and_strings_are_searched_in_linear_time() -> None:
    assert growth(lambda data: binary_strings.find(data, final=True), TSS2 + EM1000, 16 * 1024) < MAX_GROWTH


def test_noise_is_linear() -> None:
    noise = np.random.default_rng(7).integers(0, 256, TIMES * SIZE, np.uint8).tobytes()
    for protocol in registry.PROTOCOLS:

        def decode(data: bytes, protocol: str = protocol) -> None:
            decoder = registry.permissive_decoder(protocol)
            decoder.feed(data, 1)
            decoder.drain(stalled=True)

        assert growth(decode, noise, SIZE) < MAX_GROWTH
