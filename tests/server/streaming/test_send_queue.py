"""The send queue: a slow browser loses the oldest samples, counted exactly, and never events."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.streaming.ring_buffer import RingBuffer
from imuscope.server.streaming.send_queue import Frame, HistoryStream, Packet, SendQueue
from imuscope.server.wire.codec import decode_samples, encode_samples

NOTHING = HistoryStream({})


def frame(channel: int, sequence: int, n: int) -> Frame:
    data = encode_samples(channel, sequence, [np.arange(n) * 1.0] * 3, 0.0)
    return Frame(channel, n, data)


def outbox(limit: int = 10_000, channels: list[int] | None = None) -> SendQueue:
    box = SendQueue(limit=limit)
    box.subscribe(channels, NOTHING, "history_end")
    assert box.take_history(0.0) is None
    assert box.pop() == "history_end"
    assert box.is_idle
    return box


@given(st.lists(st.tuples(st.integers(1, 3), st.integers(1, 20), st.booleans()), max_size=60))
def test_sent_plus_dropped_is_everything(steps: list[tuple[int, int, bool]]) -> None:
    """Per channel: sequence numbers that arrive and the `dropped` before them account for every sample, in order."""
    box = outbox(limit=1500)
    total = dict.fromkeys((1, 2, 3), 0)
    observed = dict.fromkeys((1, 2, 3), 0)
    report = dict.fromkeys((1, 2, 3), 0)
    received = b""
    for channel, n, is_taken in steps:
        box.offer(Packet.of([frame(channel, total[channel], n), frame(3, total[3] + (n if channel == 3 else 0), 1)]))
        total[channel] += n
        total[3] += 1
        if is_taken and (message := box.pop()) is not None:
            assert isinstance(message, bytes)
            received += message
    while (message := box.pop()) is not None:
        assert isinstance(message, bytes)
        received += message
    for samples in decode_samples(received, {1: ["f8"], 2: ["f8"], 3: ["f8"]}):
        channel = samples.channel
        assert samples.sequence == observed[channel] + samples.dropped
        observed[channel] = samples.sequence + samples.n
        report[channel] += samples.dropped
    for channel in (1, 2, 3):
        assert observed[channel] <= total[channel]
        assert report[channel] <= box.dropped_of.get(channel, 0)
        if observed[channel] == total[channel]:
            assert report[channel] == box.dropped_of.get(channel, 0)


def test_samples_that_a_removed_channel_lost_do_not_hold_the_others_up() -> None:
    """All later samples waited in the queue, because the loss could not be told in any frame."""
    sent: list[bytes] = []
    box = outbox(limit=100)
    box.offer(Packet.of([frame(1, 0, 20)]))
    assert box.dropped_of == {1: 20}
    box._try_send = lambda data: not sent.append(data)  # type: ignore[func-returns-value]
    box.forget([1])
    box.offer(Packet.of([frame(2, 0, 1)]))
    assert len(sent) == 1
    assert box.is_idle


def payload(data: bytes) -> bytes:
    """Payload of an unfragmented binary frame of a server (RFC 6455, 5.2)."""
    head, length = data[0], data[1]
    assert head == 0x82
    at = {126: 4, 127: 10}.get(length, 2)
    message = length if at == 2 else int.from_bytes(data[2:at], "big")
    assert len(data) == at + message
    return data[at:]


@given(st.lists(st.sampled_from(["offer", "large", "say", "take", "open", "shut"]), max_size=80))
def test_immediate_messages_keep_their_order_and_are_sent_once(steps: list[str]) -> None:
    """A socket that takes frames at once now and then: all arrives once, in the order it was offered."""
    wire: list[str | bytes] = []
    is_open = True

    def try_send(data: bytes) -> bool:
        if is_open:
            wire.append(payload(data))
        return is_open

    box = SendQueue(limit=20_000, try_send=try_send)
    box.subscribe(None, NOTHING, "")
    assert box.take_history(0.0) is None
    assert box.pop() == ""
    total, output = 0, 0
    for step in [*steps, *["take"] * len(steps)]:
        if step in ("offer", "large"):
            n = 3 if step == "offer" else 3000
            box.offer(Packet.of([frame(1, total, n)]))
            total += n
        elif step == "say":
            box.put_message(f"{total}")
            output += 1
        elif step == "take":
            if (message := box.pop()) is not None:
                wire.append(message)
        else:
            is_open = step == "open"
    at = dropped = 0
    for message in wire:
        if isinstance(message, str):
            assert int(message) >= at, "text goes before the samples that come after it"
            continue
        for samples in decode_samples(message, {1: ["f8"]}):
            assert samples.sequence == at + samples.dropped
            at = samples.sequence + samples.n
            dropped += samples.dropped
    assert sum(isinstance(message, str) for message in wire) == output
    assert dropped <= box.dropped
    assert at == total or box.dropped > dropped


def test_nothing_is_sent_immediately_while_a_message_is_in_progress() -> None:
    went: list[bytes] = []
    box = SendQueue(try_send=lambda data: went.append(data) is None)
    box.subscribe(None, NOTHING, "")
    assert box.take_history(0.0) is None
    assert box.pop() == ""
    box.sending_since = 1.0
    box.offer(Packet.of([frame(1, 0, 5)]))
    assert not went
    assert isinstance(box.pop(), bytes)
    box.sending_since = None
    box.offer(Packet.of([frame(1, 5, 5)]))
    assert len(went) == 1
    assert box.is_idle
    assert box.sent_bytes == len(payload(went[0]))


def test_a_slow_browser_receives_the_exact_number_of_dropped_samples() -> None:
    box = outbox(limit=3 * len(frame(1, 0, 10).data))
    for k in range(10):
        box.offer(Packet.of([frame(1, 10 * k, 10)]))
    message = box.pop()
    assert isinstance(message, bytes)
    got = decode_samples(message, {1: ["f8"]})
    assert [samples.sequence for samples in got] == [70, 80, 90]  # the oldest went
    assert [samples.dropped for samples in got] == [70, 0, 0]
    assert box.dropped_of == {1: 70}


def test_events_are_never_dropped_and_go_first() -> None:
    box = outbox(limit=100)
    for k in range(500):
        box.offer(Packet.of([frame(1, k, 1)]))
        box.put_message(f"event {k}")
    assert [box.pop() for _ in range(500)] == [f"event {k}" for k in range(500)]


def test_only_the_newest_state_waits() -> None:
    box = outbox()
    for k in range(5):
        box.put_latest("health", f"health {k}")
        box.put_latest("devices", f"devices {k}")
    assert [box.pop(), box.pop(), box.pop()] == ["health 4", "devices 4", None]


def test_nothing_flows_before_the_first_subscribe() -> None:
    box = SendQueue()
    box.offer(Packet.of([frame(1, 0, 5)]))
    assert box.is_idle


def test_only_subscribed_channels_are_sent() -> None:
    box = outbox(channels=[2])
    shared = Packet.of([frame(1, 0, 5), frame(2, 0, 5)])
    box.offer(shared)
    box.offer(Packet.of([frame(1, 5, 5)]))
    message = box.pop()
    assert message == shared.frames[1].data
    assert box.pop() is None


def test_a_packet_is_shared_and_not_copied() -> None:
    boxes = [outbox(), outbox()]
    packet = Packet.of([frame(1, 0, 5)])
    for box in boxes:
        box.offer(packet)
    assert boxes[0].pop() is packet.data
    assert boxes[1].pop() is packet.data


def test_subscribing_again_discards_queued_samples() -> None:
    box = outbox()
    box.offer(Packet.of([frame(1, 0, 5)]))
    box.subscribe(None, NOTHING, "again")
    assert box.pop() is None
    assert box.dropped_of == {}  # forgotten on request is not dropped


def test_history_is_newest_first_and_one_message_at_a_time() -> None:
    rings = {1: RingBuffer(["f4"]), 2: RingBuffer(["f8"])}
    for number, ring in rings.items():
        n = 20_000 // number
        ring.append([np.arange(n) * 0.01 * number, np.zeros(n), np.zeros(n)])
    history = HistoryStream({number: (ring, 0, ring.total) for number, ring in rings.items()})
    ends = {1: 20_000, 2: 10_000}
    newest = float("inf")
    while (message := history.pop(0.0, limit=50_000)) is not None:
        assert len(message) < 50_000 + 70_000
        results = decode_samples(message, {1: ["f4"], 2: ["f8"]})
        for samples in results:
            assert samples.history
            assert samples.sequence + samples.n == ends[samples.channel]
            ends[samples.channel] = samples.sequence
        assert results[0].columns[0][-1] <= newest + 150  # messages go back in time, to within a block
        newest = results[0].columns[0][-1]
    assert ends == {1: 0, 2: 0}
