"""Properties of every protocol for any bytes: one module, one row per protocol.

    - any split into chunks gives the same events; so does one byte at a time
    - arbitrary bytes raise nothing, and leave at most one maximal frame (and an unfinished text) buffered
    - a good frame survives whatever comes before it
    - the fast decoder finds what the slow oracle finds
    - what a frame says as plain values is the frame again
    - without compilation the answers are the same

Profiles `fast` and `deep` are those of tests/conftest.py.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.idtp import frames as idtp
from imuscope.protocols.isb import frames as isb
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.frames import build
from tests.protocols import mip_vectors
from tests.protocols.idtp import idtp_vectors
from tests.protocols.isb import isb_vectors
from tests.protocols.protocol_cases import KEY, SPEAKERS, ProtocolCase, canonical, cut, run
from tests.protocols.xbus.xbus_vectors import everything
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

# -- Xbus --------------------------------------------------------------------------------------------------------------

VECTORS = [data for data in everything() if len(data) < 400]

items = st.lists(
    st.tuples(
        st.sampled_from([0x1020, 0x1060, 0x1070, 0x2010, 0x4022, 0x7020, 0xA080, 0xE020, 0x4FF0]),
        st.binary(max_size=24),
    ),
    max_size=5,
).map(lambda pairs: b"".join(i.to_bytes(2, "big") + bytes([len(v)]) + v for i, v in pairs))

xbus_frames = st.one_of(
    st.sampled_from(VECTORS),
    st.builds(build, st.just(0x36), st.one_of(items, st.builds(bytes.__add__, items, st.binary(max_size=6)))),
    st.builds(
        lambda counter, ticks: build(0x36, b"\x10\x20\x02" + counter + b"\x10\x60\x04" + ticks),
        st.integers(0, 65535).map(lambda n: n.to_bytes(2, "big")),
        st.integers(0, 2**32 - 1).map(lambda n: n.to_bytes(4, "big")),
    ),
    st.builds(
        lambda mid, payload, bid, extended: build(mid, payload, bid, extended=extended),
        st.integers(1, 255),
        st.binary(max_size=40),
        st.integers(0, 255),
        st.booleans(),
    ),
)


# -- ISB ---------------------------------------------------------------------------------------------------------------

isb_frames = st.one_of(
    st.sampled_from([data for data in isb_vectors.everything() if len(data) < 400]),
    st.builds(  # clocks that agree and clocks that do not
        lambda did, payload, seconds: isb.build(isb.DATA, did, struct.pack("<d", seconds) + payload),
        st.sampled_from([3, 52, 53, 58]),
        st.binary(min_size=28, max_size=28),
        st.sampled_from([1.0, 1.001, 1.5, 500.0, 20.0]),
    ),
    st.builds(
        lambda week, tow, payload: isb.build(isb.DATA, 4, struct.pack("<Id", week, tow) + payload),
        st.sampled_from([0, 2392, 2393, 7]),
        st.sampled_from([1.0, 2.0, 604_799.9, 500.0]),
        st.binary(min_size=68, max_size=68),
    ),
    st.builds(
        lambda did, kind, payload, offset: isb.build(kind, did, payload, offset=offset),
        st.sampled_from([4, 4, 4, 8, 10, 12, 13, 15, 30, 42, 58, 69, 75, 79, 119, 200]),
        st.sampled_from([isb.DATA, isb.DATA, isb.SET_DATA]),
        st.binary(max_size=90),
        st.sampled_from([None, 0, 1, 4, 20, 44, 200]),
    ),
    st.builds(
        lambda kind, payload, flags: isb.build(kind, 0, payload, flags=flags),
        st.sampled_from([isb.ACK, isb.NACK, isb.GET_DATA, isb.STOP_DID, isb.STOP_CURRENT_PORT]),
        st.one_of(st.just(b""), st.binary(max_size=3), st.just(bytes([4, 0, 0, 0, 0, 0, 1, 0])), st.just(bytes(9))),
        st.sampled_from([0, 0x10, 0x80]),
    ),
    st.builds(
        lambda version: isb.build(isb.DATA, 1, bytes(12) + bytes(version) + bytes(68)),
        st.tuples(st.just(2), st.integers(0, 8), st.integers(0, 9), st.just(0)),
    ),
)


# -- IDTP --------------------------------------------------------------------------------------------------------------

idtp_frames = st.one_of(
    st.sampled_from([idtp_vectors.frame(v) for v in idtp_vectors.VECTORS if idtp_vectors.key_of(v) in (None, KEY)]),
    st.builds(  # few devices, near and far numbers, clocks that agree and clocks that do not
        lambda kind, payload, sequence, device, mode, timestamp, version: idtp.build(
            kind,
            payload,
            sequence=sequence,
            device=device,
            mode=mode,
            timestamp=timestamp,
            version=version,
            key=KEY,
        ),
        st.sampled_from([0, 0, 3, 6, 6, 7, 0x80, 0x91]),
        st.one_of(st.binary(min_size=12, max_size=24), st.binary(max_size=40), st.just(b"IDTP" + bytes(12))),
        st.sampled_from([0, 1, 2, 3, 5, 100, 65_537, 70_000, 70_001, 2**31, 2**31 + 1, 2**32 - 1]),
        st.sampled_from([1, 1, 2]),
        st.sampled_from([0, 0, 1, 1, 2]),
        st.sampled_from([0, 1000, 2000, 2**31, 2**32 - 1]),
        st.sampled_from([0x21, 0x21, 0x21, 0x20, 0x22]),
    ),
)


# -- MIP, of the plug-in -----------------------------------------------------------------------------------------------

mip_frames = st.one_of(
    st.sampled_from(mip_vectors.everything()),
    st.builds(
        mip_vectors.build,
        st.sampled_from([0x01, 0x0C, 0x0D, 0x80, 0x80, 0x82, 0x82, 0x91, 0xA0]),
        st.lists(
            st.one_of(
                st.tuples(st.sampled_from([0x04, 0x05, 0x06]), st.binary(min_size=12, max_size=12)),
                st.tuples(st.sampled_from([0x11, 0x12]), st.binary(min_size=12, max_size=13)),
                st.tuples(st.sampled_from([0x01, 0x03, 0x05]), st.sampled_from([bytes(14), bytes(18), bytes(26)])),
                st.tuples(st.sampled_from([0xF1, 0x81, 0xD5]), st.binary(min_size=2, max_size=12)),
                st.tuples(st.integers(0, 255), st.binary(max_size=12)),
            ),
            min_size=1,
            max_size=6,
        ),
    ),
)


FRAMES = {"xbus": xbus_frames, "isb": isb_frames, "idtp": idtp_frames, "mip": mip_frames}
"""Protocol → a strategy for its frames."""

speakers = each_row("speaker", SPEAKERS.values(), ids=lambda speaker: speaker.name)


@st.composite
def streams(draw: st.DrawFn, speaker: ProtocolCase) -> bytes:
    """Frames, damaged frames, sentences and noise, in any order."""
    noise = st.one_of(
        st.binary(max_size=30),
        st.lists(
            st.sampled_from([speaker.preamble, speaker.preamble + b"\x04", b"\xff", b"\x00", b"\x36", b"\x05", b"$"]),
            max_size=12,
        ).map(b"".join),
        st.sampled_from(
            [
                b"$HCHDM,123.45,M*18\r\n",
                b"$HCHDM,123.45,M*00\r\n",
                b"$GPZDA,1",
                b"\xfa\xff\x36\xff\x1f\xf0",
                b"\xb5\x62\x05\x01\x02\x00\x06\x00\x0e\x37",
                b"\xb5\x62\x01\x07\x40\x00",
                b"\xd3\x00\x13\x3e\xd7",
                b"INDT",
                b"ID",
            ]
        ),
    )
    damaged = st.builds(
        lambda data, at, byte: data[: at % len(data)] + bytes([byte]) + data[at % len(data) + 1 :],
        FRAMES[speaker.name],
        st.integers(0, 1000),
        st.integers(0, 255),
    )
    short = st.builds(lambda data, at: data[: at % len(data)], FRAMES[speaker.name], st.integers(0, 1000))
    return b"".join(
        draw(st.lists(st.one_of(FRAMES[speaker.name], FRAMES[speaker.name], noise, damaged, short), max_size=12))
    )


# -- properties --------------------------------------------------------------------------------------------------------


@speakers
@given(data=st.data())
def test_any_chunks(speaker: ProtocolCase, data: st.DataObject) -> None:
    stream = data.draw(streams(speaker))
    places = data.draw(st.lists(st.integers(0, 100_000), max_size=12))
    assert canonical(run(speaker, cut(stream, places))) == canonical(run(speaker, [stream]))


@speakers
@given(data=st.data())
def test_one_byte_at_a_time(speaker: ProtocolCase, data: st.DataObject) -> None:
    stream = data.draw(streams(speaker))[:600]
    assert canonical(run(speaker, [bytes([byte]) for byte in stream])) == canonical(run(speaker, [stream]))


@speakers
@given(data=st.data())
def test_many_chunks_at_once(speaker: ProtocolCase, data: st.DataObject) -> None:
    """As a recording is read: all chunks in one call, each with its time of arrival."""
    stream = data.draw(streams(speaker))
    chunks = [one for one in cut(stream, data.draw(st.lists(st.integers(0, 100_000), max_size=12))) if one]
    singly, at_once = speaker.family.decoding.decoder(), speaker.family.decoding.decoder()
    for arrival, chunk in enumerate(chunks):
        singly.feed(chunk, 1000 + arrival)
    ends, times = np.cumsum([len(one) for one in chunks], dtype=np.int64), 1000 + np.arange(len(chunks))
    at_once.feed_chunks(stream, ends, times)
    expected, result = singly.drain(stalled=True), at_once.drain(stalled=True)
    assert canonical(result) == canonical(expected)
    for one, other in zip(result, expected, strict=True):
        assert np.array_equal(getattr(one, "arrival_ns", 0), getattr(other, "arrival_ns", 0))


@speakers
def test_a_frame_at_a_time(speaker: ProtocolCase) -> None:
    """A live stream has one frame per drain, which is decoded with plain numbers; twice, so that each layout is known
    the second time, with losses and disorder in between.
    """
    frames = [*speaker.everything()] * 2
    assert canonical(run(speaker, frames)) == canonical(run(speaker, [b"".join(frames)]))


@speakers
@given(noise=st.binary(max_size=3000), places=st.lists(st.integers(0, 3000), max_size=4))
@example(noise=b"\xfa" * 300, places=[])
@example(noise=b"\x00\x90" * 300, places=[7])
@example(noise=b"\xfa\xff\x36\xff\x1f\xf9" + b"\xfa" * 200, places=[100])
@example(noise=b"\xef\x49" * 300, places=[7])
@example(noise=b"\xef\x49\x04\x04\x00\x04" + b"\xef" * 200, places=[100])
def test_arbitrary_bytes(speaker: ProtocolCase, noise: bytes, places: list[int]) -> None:
    events = run(speaker, cut(noise, places))
    for event in events:
        if isinstance(event, Batch):
            for name in event.columns:
                assert len(event.columns[name]) == len(event)


@speakers
@given(data=st.data())
def test_good_frame_survives(speaker: ProtocolCase, data: st.DataObject) -> None:
    """A frame after any damage is found, unless the damage contains a frame that overlaps it or makes it stale."""
    before = data.draw(st.one_of(st.binary(max_size=60), streams(speaker)))
    frame = data.draw(FRAMES[speaker.name])
    frames, rejects = speaker.expected(before + frame)
    reach = [offset for offset, _ in frames]
    whole = any(offset == 0 for offset, _ in speaker.expected(frame)[0])
    events = run(speaker, [before, frame])
    results = {int(o) for e in events if isinstance(e, Batch) for o in e.offset} | {
        e.offset for e in events if isinstance(e, Reply)
    }
    results -= {e.offset for e in events if isinstance(e, Reply) and e.message.name == "Warning" and e.size == 4}
    assert results == set(reach)
    old = (len(before), "stale") in rejects or (len(before), "far_ahead") in rejects
    swallowed = any(offset < len(before) < end for offset, end in spans(events))
    assert not whole or swallowed or old or len(before) in results


def spans(events: Sequence[Event]) -> list[tuple[int, int]]:
    """Positions of replies and batch rows, with a generous end for rows."""
    out = [(e.offset, e.offset + e.size) for e in events if isinstance(e, Reply)]
    for event in events:
        if isinstance(event, Batch):
            size = event.size or sum(np.asarray(event.columns[n][0]).nbytes + 3 for n in event.columns) + 7
            out += [(int(o), int(o) + size) for o in event.offset]
    return out


@speakers
@given(data=st.data())
def test_like_the_oracle(speaker: ProtocolCase, data: st.DataObject) -> None:
    stream = data.draw(streams(speaker))
    frames, rejects = speaker.expected(stream)
    decoder = speaker.family.frames.listing()
    decoder.feed(stream)
    lines = decoder.drain(stalled=True)
    got = [line for line in lines if "reject" not in line and line["protocol"] == speaker.name]
    assert [line["offset"] for line in got] == [offset for offset, _ in frames]
    for line, (_, expected) in zip(got, frames, strict=True):
        assert (speaker.of_line(line) if isinstance(expected, str) else line["id"]) == expected
    first = speaker.preamble[0]
    failed = [
        (line["offset"], line["reject"]) for line in lines if "reject" in line and stream[line["offset"]] == first
    ]
    assert [one for one in failed if one[1] != "bad_item"] == rejects


@speakers
@given(data=st.data())
def test_plain_values_are_the_frame(speaker: ProtocolCase, data: st.DataObject) -> None:
    frame = data.draw(FRAMES[speaker.name])
    assert speaker.again(speaker.plain(frame)) == frame
    record = json.loads(json.dumps(speaker.plain(frame), allow_nan=False))
    assert speaker.again(record) == frame


SCRIPT = """
import sys
from pathlib import Path
from tests.protocols.protocol_cases import SPEAKERS, canonical, run
from tests.support.each_row import each_row
for path in sorted(Path(sys.argv[1]).iterdir()):
    data = path.read_bytes()
    lines = canonical(run(SPEAKERS[path.name], [data[:1000], data[1000:]]))
    path.write_text("\\n".join(lines))
"""


def test_without_compilation(tmp_path: Path) -> None:
    """IMUSCOPE_PLAIN_PYTHON=1 runs the same source as plain Python and gives the same answers."""
    noise = bytes(range(256)) + b"\xfa\xff\x36\x05" + b"$HCHDM,123.45,M*18\r\n" + b"\xfa\xff\x36\xff\x1f\xff"
    streams = {name: noise.join(one.everything())[:60_000] for name, one in SPEAKERS.items()}
    streams["isb"] += IsbSimulator().advance(7 * 10**9)[-20_000:]  # its clocks go from uptime to time of week
    for name, stream in streams.items():
        (tmp_path / name).write_bytes(stream)
    environment = {**os.environ, "IMUSCOPE_PLAIN_PYTHON": "1", "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", SCRIPT, str(tmp_path)], env=environment, cwd=ROOT, check=True)
    for name, stream in streams.items():
        plain = (tmp_path / name).read_text()
        assert plain.split("\n") == canonical(run(SPEAKERS[name], [stream[:1000], stream[1000:]])), name
        assert len(plain) > 5_000


INTERPRETED = (
    *("xbus/test_decoder.py", "isb/test_decoder.py", "idtp/test_decoder.py", "clocks/test_counters.py"),
    *("clocks/test_kernels.py", "clocks/test_chunk_boundaries.py", "test_properties.py::test_like_the_oracle"),
)


def test_the_tests_of_decoders_pass_without_compilation() -> None:
    """Where no machine code was built, the loops are these."""
    names = [f"tests/protocols/{name}" for name in INTERPRETED]
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *names]
    env = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}  # a profile counts them twice
    done = subprocess.run(command, env={**env, "IMUSCOPE_PLAIN_PYTHON": "1"}, cwd=ROOT, capture_output=True)
    assert done.returncode == 0, done.stdout.decode()
