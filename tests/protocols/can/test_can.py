"""CAN messages of an MTi: scales and bytes, sample groups, clocks and losses; and the stream in pieces."""

import random

import numpy as np
import pytest

from imuscope.protocols.can.decoder import CanDecoder
from imuscope.protocols.can.definition import default_definition, number_of, read_definition, step_line
from imuscope.protocols.can.mti import MTI
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap
from imuscope.protocols.registry.families import OF_FILES, PROTOCOLS, family_of
from imuscope.protocols.xbus.data_identifiers import BY_NAME
from tests.support.each_row import each_row

S = 1_000_000_000
BEGIN = 1_767_225_600 * S


def line(number: str, data: str, time_ns: int = BEGIN) -> bytes:
    return f"({time_ns // S}.{time_ns % S // 1000:06}) can0 {number}#{data.replace(' ', '')}\n".encode()


def decoded(*lines: bytes, step_ns: int = 500_000, decoder: CanDecoder | None = None) -> list[Event]:
    """Events of lines that arrive one after the other."""
    decoder = decoder or CanDecoder()
    for place, one in enumerate(lines):
        decoder.feed(one, BEGIN + place * step_ns)
    return decoder.drain(stalled=True)


def batches(events: list[Event]) -> list[Batch]:
    """Batches, those with the same quantities as one: the newest group comes by itself."""
    kinds: dict[tuple[object, ...], list[Batch]] = {}
    for event in events:
        if isinstance(event, Batch):
            key = event.message.name, tuple(event.columns), event.time_ns is None
            kinds.setdefault(key, []).append(event)
    return [joined(some) for some in kinds.values()]


def joined(some: list[Batch]) -> Batch:
    first = some[0]
    columns = {name: np.concatenate([one.columns[name] for one in some]) for name in first.columns}
    arrivals, offsets = (np.concatenate(parts) for parts in zip(*((b.arrival_ns, b.offset) for b in some), strict=True))
    times = None if first.time_ns is None else np.concatenate([one.time_ns for one in some if one.time_ns is not None])
    return Batch(first.message, "", arrivals, offsets, times, columns)


VECTORS = [  # computed from MT1604P by a third party, for a simulator of an MTi-680G
    ("034", "00 00 00 00 09 CF", "Acceleration", (0, 0, 9.80859375)),
    ("034", "01 80 FD C0 09 CF", "Acceleration", (1.5, -2.25, 9.80859375)),
    ("034", "7F FF 7F FF 7F FF", "Acceleration", (127.99609375,) * 3),
    ("034", "80 00 80 00 80 00", "Acceleration", (-128,) * 3),
    ("034", "FF FF FF FF FF FF", "Acceleration", (-0.00390625,) * 3),
    ("034", "CF 09 00 00 00 00", "Acceleration", (-48.96484375, 0, 0)),
    ("034", "00 00 00 00 09 CF DE AD", "Acceleration", (0, 0, 9.80859375)),
    ("032", "00 33 FF 80 05 00", "RateOfTurn", (0.099609375, -0.25, 2.5)),
    ("032", "46 00 46 00 46 00", "RateOfTurn", (35, 35, 35)),
    ("022", "06 40 FE 60 D3 00", "EulerAngles", (12.5, -3.25, -90)),
    ("022", "00 00 00 00 5A 00", "EulerAngles", (0, 0, 180)),
    ("076", "06 E0 FF B0 00 04", "VelocityXYZ", (27.5, -1.25, 0.0625)),
    ("021", "7F FF 00 00 00 00 00 00", "Quaternion", (1, 0, 0, 0)),
    ("021", "80 01 00 00 00 00 00 00", "Quaternion", (-1, 0, 0, 0)),
    ("006", "12 34", "PacketCounter", 0x1234),
    ("005", "FF FF FF FF", "SampleTimeFine", 0xFFFFFFFF),
    ("011", "00 00 00 01", "StatusWord", 1),
    # computed here, by hand, from the same tables
    ("035", "FF 00 01 00 00 80", "FreeAcceleration", (-1, 1, 0.5)),
    ("041", "02 00 FE 00 04 00", "MagneticField", (0.5, -0.5, 1)),
    ("051", "F3 80", "Temperature", -12.5),
    ("052", "C5 E6 A0 00", "BaroPressure", 101_325.25),
    ("031", "01 00 FF 00 00 80 0A", "DeltaV", (0.25, -0.25, 0.125)),
    ("033", "7F FF 00 00 00 00 00 00", "DeltaQ", (1, 0, 0, 0)),
    ("071", "30 00 00 00 FA 40 00 00", "LatLon", (48, -11.5)),
    ("072", "FF FE 40 00", "AltitudeEllipsoid", -3.5),
    ("061", "02 00 00 00 FE 00", "RateOfTurnHR", (1, 0, -1)),
    ("062", "01 00 00 00 FF 00", "AccelerationHR", (1, 0, -1)),
    ("073", "FF FF FF 00", "PositionEcefX", -1),
    ("074", "00 00 01 80", "PositionEcefY", 1.5),
    ("075", "00 00 02 00", "PositionEcefZ", 2),
    ("007", "1A 01 02 03 04 05 00 0A", "UtcTime", (1_000_000, 2026, 1, 2, 3, 4, 5)),
    ("079", "03 0C 01 07 10", "GnssReceiverStatus", (3, 12, 1, 7, 16)),
    ("07A", "00 96 00 64 00 7D 00 50", "GnssReceiverDop", (1.5, 1, 1.25, 0.8)),
]


@each_row(("number", "data", "name", "values"), VECTORS)
def test_messages_have_the_scales_of_the_documents(number: str, data: str, name: str, values: object) -> None:
    [batch] = batches(decoded(line(number, data)))
    value = batch.columns[name][0]
    np.testing.assert_allclose(value.tolist() if value.dtype.names else value, values, rtol=1e-12)


def test_every_message_has_a_vector() -> None:
    quantities = {row.name for row in MTI.rows if row.role != "report"}
    assert quantities == {name for _, _, name, _ in VECTORS}


def test_quantities_have_the_units_and_frames_of_mtdata2() -> None:
    for row in MTI.rows:
        known = BY_NAME.get(row.name)
        if known is not None:
            frame = known.frame.replace("local", "ENU")
            assert (row.field.unit, row.field.axes, row.field.frame) == (known.unit, known.axes, frame), row.name
        assert row.source


def sample(n: int, *, time: bool = True, slow: bool = False) -> list[bytes]:
    """The lines of a sample at 100 Hz."""
    at = BEGIN + n * S // 100
    lines = [line("005", f"{100 * n:08X}", at)] if time else []
    lines += [
        line("006", f"{n % 65_536:04X}", at),
        line("021", "7FFF000000000000", at),
        line("034", "0000000009CF", at),
    ]
    return lines + ([line("051", "1980", at)] if slow else [])


def stream(*samples: list[bytes]) -> list[Event]:
    decoder = CanDecoder()
    for n, lines in enumerate(samples):
        for place, one in enumerate(lines):
            decoder.feed(one, BEGIN + n * S // 100 + place * 300_000)
    return decoder.drain(stalled=True)


def test_frames_of_one_sample_are_one_row() -> None:
    events = stream(*(sample(n, slow=n == 3) for n in range(6)))
    usual, with_slow = sorted(batches(events), key=lambda one: -len(one))
    assert [len(usual), len(with_slow)] == [5, 1]
    assert list(usual.columns) == ["SampleTimeFine", "PacketCounter", "Quaternion", "Acceleration"]
    assert usual.time_ns is not None
    assert (np.diff(usual.time_ns) // 1_000_000).tolist() == [10, 10, 20, 10]
    assert ((usual.arrival_ns - BEGIN) // 1_000_000).tolist() == [0, 10, 20, 40, 50]
    assert with_slow.columns["Temperature"].tolist() == [25.5]


def test_lost_frames_leave_their_sample_and_no_other() -> None:
    """Without its SampleTime a sample has no device time; the one before does not lend its own."""
    samples = [sample(n, time=n != 2) for n in range(5)]
    del samples[3][2]
    events = stream(*samples)
    timed = {tuple(one.columns): one for one in batches(events) if one.time_ns is not None}
    [untimed] = [one for one in batches(events) if one.time_ns is None]
    assert untimed.columns["PacketCounter"].tolist() == [2]
    assert timed["SampleTimeFine", "PacketCounter", "Acceleration"].columns["PacketCounter"].tolist() == [3]
    assert not [event for event in events if isinstance(event, SampleGap)]


def test_missing_groups_are_counted() -> None:
    events = stream(*(sample(n) for n in (65_533, 65_534, 65_537, 65_538)))
    [gap] = [event for event in events if isinstance(event, SampleGap)]
    assert (gap.missing, gap.counter) == (2, "PacketCounter")
    assert not [event for event in events if isinstance(event, ClockStep)]


def test_a_restart_of_the_device_is_a_step() -> None:
    events = stream(*(sample(n) for n in (1000, 1001, 1002, 0, 1, 2)))
    [step] = [event for event in events if isinstance(event, ClockStep)]
    assert (step.kind, step.by_ns) == ("reset", -10_030_000_000)


def test_high_rate_messages_are_apart() -> None:
    fast = [line("061", "020000000000"), line("062", "010000000000")]
    events = stream(*([*sample(n), *fast, *fast] for n in range(3)))
    kinds = {one.message.name: one for one in batches(events)}
    assert {name: len(one) for name, one in kinds.items()} == {"SampleGroup": 3, "HighRate": 6}
    assert kinds["HighRate"].time_ns is None


def test_ecef_is_a_vector_where_it_is_whole() -> None:
    parts = [line("073", "00000100"), line("074", "00000200"), line("075", "00000300")]
    whole, alone = batches(stream(parts, parts[:1]))
    assert whole.columns["PositionEcef"].tolist() == [[1, 2, 3]]
    assert whole.message.fields[0].frame == "ECEF"
    assert alone.columns["PositionEcefX"].tolist() == [1]


def test_errors_are_events() -> None:
    [error, warning] = [event for event in decoded(line("001", "01"), line("002", "05")) if isinstance(event, Reply)]
    assert (error.message.name, error.values, error.message.fields[0].choices[1][:17]) == (
        "Error",
        {"Error": 1},
        "the output buffer",
    )
    assert (warning.message.name, warning.values) == ("Warning", {"Warning": 5})


def test_utc_is_the_clock_without_a_sample_time() -> None:
    lines = [line("007", f"1A010100000{n:01X}0000") for n in range(3)]
    [batch] = batches(decoded(*lines, step_ns=S))
    assert batch.time_ns is not None
    assert batch.time_ns.tolist() == [BEGIN, BEGIN + S, BEGIN + 2 * S]
    late = decoded(*lines, line("005", "00000001"), step_ns=S)
    assert [event.kind for event in late if isinstance(event, ClockStep)] == ["sync"]


def test_short_frames_and_others_are_no_samples() -> None:
    events = decoded(
        line("034", "000009CF"), line("034", ""), line("100", "00"), line("21", "00"), b"(1.5) can0 034#R\n"
    )
    assert not batches(events)
    assert [event.reason for event in events if isinstance(event, RejectedFrame)] == [
        "bad_size",
        "bad_size",
        "bad_item",
    ]


def test_a_definition_names_other_identifiers() -> None:
    definition = b'#CAN {"kind": "mti", "identifiers": {"19FF0034": "Acceleration"}, "tick_ns": 100000}\n'
    events = decoded(definition, line("19FF0034", "0000000009CF"), line("034", "0000000009CF"))
    assert [len(one) for one in batches(events)] == [1]


@each_row("body", [b"", b"{}", b"[]", b'{"kind": "x"}', b'{"kind": "mti", "identifiers": 3, "tick_ns": 1}', b"\xff"])
def test_a_damaged_definition_changes_nothing(body: bytes) -> None:
    assert read_definition(body) is None
    assert batches(decoded(b"#CAN " + body + b"\n", line("034", "0000000009CF")))


def test_a_definition_is_read_as_it_was_written() -> None:
    definition = default_definition()
    assert read_definition(definition.line().removeprefix(b"#CAN ")) == definition


@each_row("text", ["", "xyz", "0x", "123456789", "-12", "FFFFFFFF"])
def test_what_is_no_identifier_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"identifier|invalid literal"):
        number_of(text)


def test_a_step_of_the_log_is_one_of_a_device_without_a_clock() -> None:
    acceleration = line("034", "0000000009CF")
    [step] = [one for one in decoded(acceleration, step_line(-2 * S), acceleration) if isinstance(one, ClockStep)]
    assert (step.kind, step.by_ns) == ("log", -2 * S)
    timed = [line("005", "00000001"), step_line(-2 * S), line("005", "00000002")]
    assert not [one for one in decoded(*timed) if isinstance(one, ClockStep)]


def test_the_events_do_not_depend_on_the_pieces() -> None:
    data = (
        b"".join(b"".join(sample(n, time=n % 7 > 0, slow=n % 5 == 0)) for n in range(40))
        + b"(noise\n#CAN {\n(1.5) x 1\n"
    )
    data = data.replace(b"021#7FFF", b"021#7FF", 3)
    whole = flat(data, [len(data)])
    chance = random.Random(1)
    for _ in range(20):
        cuts = sorted(chance.sample(range(1, len(data)), 30))
        assert flat(data, [*cuts, len(data)]) == whole
    assert flat(data, list(range(1, len(data) + 1))) == whole


def flat(data: bytes, cuts: list[int]) -> list[tuple[object, ...]]:
    """Events as rows; all bytes arrive at once, so that the pieces alone differ."""
    decoder, at, events = CanDecoder(), 0, list[Event]()
    for cut in cuts:
        decoder.feed(data[at:cut], BEGIN)
        events += decoder.drain()
        at = cut
    events += decoder.drain(stalled=True)
    rows: list[tuple[object, ...]] = []
    for event in events:
        if isinstance(event, Batch):
            times = event.time_ns.tolist() if event.time_ns is not None else [None] * len(event)
            names = tuple(event.columns)
            values = zip(*(column.tolist() for column in event.columns.values()), strict=True)
            rows += [(o, t, names, str(v)) for o, t, v in zip(event.offset.tolist(), times, values, strict=True)]
        elif isinstance(event, RejectedFrame):
            rows.append((event.offset, "reject", (event.reason,), str(event.size)))
        else:
            rows.append((event.offset, type(event).__name__, (), ""))  # type: ignore[union-attr]
    return sorted(rows, key=str)


def test_the_stream_is_no_choice_for_a_port() -> None:
    assert "can" not in PROTOCOLS
    assert family_of("can") is OF_FILES["can"]
