"""The two binary strings of an MTi are found at their positions and nowhere else.

Computed by hand from MT0101P 2020.A, 5.3.5: heading 123.45°, roll −1.50°, pitch 2.50°, heave 0.
"""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import ParsedMessage
from imuscope.protocols.xbus.binary_strings import WINDOW_BYTES, Em1000Row, find
from tests.protocols.embedded.nmea_sentences import EM1000, TSS2
from tests.support.each_row import each_row


def test_tss2() -> None:
    result, stored = find(TSS2 + b"\r\n", final=False)
    assert result == [
        ParsedMessage(
            0,
            27,
            "tss2",
            "TSS2",
            TSS2.decode(),
            {"heading": 123.45, "heave": 0.0, "status": "H", "roll": -1.5, "pitch": 2.5, "headingStatus": "F"},
        )
    ]
    assert stored == 27


def test_tss2_without_line_ends() -> None:
    results, _ = find(TSS2 * 3, final=True)
    assert [(one.offset, one.size) for one in results] == [(0, 25), (25, 25), (50, 25)]


@each_row("wrong", [b":36000  0000H-0150  0250F", b":1234x  0000H-0150  0250F", b":12345  0000H+0150  0250F"])
def test_bytes_that_resemble_tss2_are_rejected(wrong: bytes) -> None:
    assert find(wrong + b"\r\n", final=True)[0] == []


def test_em1000_is_accepted_when_two_more_follow() -> None:
    results, _ = find(EM1000 * 5, final=True)
    assert [one.offset for one in results] == [0, 10, 20, 30, 40]
    assert results[0].fields == {"roll": -1.5, "pitch": 2.5, "heave": 0.0, "heading": 123.45}
    assert (results[0].protocol, results[0].name, results[0].size) == ("em1000", "EM1000", 10)
    assert find(EM1000 * 2, final=True)[0] == []


def test_em1000_continues_a_run() -> None:
    assert [one.offset for one in find(EM1000 * 5, final=True, row=Em1000Row(0))[0]] == [0, 10, 20, 30, 40]
    assert find(EM1000, final=True, row=Em1000Row(-WINDOW_BYTES - 1))[0] == []


def test_em1000_is_found_wherever_a_device_may_send_it() -> None:
    """A cycle longer than 300 bytes, frames, or pauses between the records made them vanish."""
    others = b"$GPGGA," + b"1" * 70 + b"*00\r\n"
    apart = (EM1000 + others * 13 + TSS2 + b"\r\n") * 5
    assert len([one for one in find(apart, final=True)[0] if one.name == "EM1000"]) == 5
    row = Em1000Row(-WINDOW_BYTES - 1, 0)
    results = []
    for _ in range(5):  # each between two frames, or alone in a second
        results.append(len(find(EM1000, final=True, row=row)[0]))
        row.end -= 10 + WINDOW_BYTES // 2
    assert results == [0, 0, 1, 1, 1]


def test_em1000_among_other_strings() -> None:
    results, _ = find((EM1000 + TSS2 + b"\r\n" + b"$HCHDM,1.0,M*00\r\n") * 4, final=True, row=Em1000Row(0))
    assert [one.name for one in results] == ["EM1000", "TSS2"] * 4


@each_row(
    "record",
    [
        "00 90 6A FF FA 00 01 00 39 30",  # a heave
        "00 90 6A FF FA 00 00 00 A0 8C",  # heading 360.00°
        "00 90 00 80 FA 00 00 00 39 30",  # roll −327.68°
        "00 90 6A FF 29 23 00 00 39 30",  # pitch 90.01°
    ],
)
def test_bytes_that_resemble_em1000_are_rejected(record: str) -> None:
    assert find(bytes.fromhex(record) * 4, final=True)[0] == []


def test_noise_holds_no_strings() -> None:
    data = random.Random(1).randbytes(1_000_000)
    assert find(data, final=True)[0] == []


def pieces(data: bytes, cuts: list[int]) -> list[tuple[int, str]]:
    results: list[tuple[int, str]] = []
    start = end = 0
    row = Em1000Row(-WINDOW_BYTES - 1, 0)
    for size in [*cuts, len(data)]:
        end = min(end + size, len(data))
        now, stored = find(data[start:end], final=end == len(data), row=row)
        results += [(one.offset + start, one.name) for one in now]
        start += stored
        row.end -= stored
    return results


parts = st.binary(max_size=12) | st.sampled_from(
    [TSS2, TSS2 + b"\r\n", EM1000, EM1000 * 3, b"\0", b"\0\x90", b":", b"\r"]
)


@given(st.lists(parts, max_size=9).map(b"".join), st.lists(st.integers(0, 30), max_size=25))
def test_cutting_changes_nothing(data: bytes, cuts: list[int]) -> None:
    assert pieces(data, cuts) == [(one.offset, one.name) for one in find(data, final=True)[0]]


@given(st.binary(max_size=200), st.booleans(), st.none() | st.integers(0, 2000))
def test_any_bytes_are_survived(data: bytes, final: bool, since: int | None) -> None:
    row = Em1000Row(-since) if since is not None else None
    results, stored = find(memoryview(data), final=final, row=row)
    assert 0 <= stored <= len(data)
    assert all(one.offset + one.size <= stored for one in results)
