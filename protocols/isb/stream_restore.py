"""Restoration of streams after a transaction: those running before it run after it.

    body      Send GET DID_GPS1_SAT, period 0     Expect its answer
                 │ it streams: not sent              │ the next packet of the stream is the answer
                 │ it does not: sent                 v
                 v                                   the body
    after it  requested nevertheless, and streamed: does it still?  ──no──>  GET_DATA with its period

A GET_DATA of period 0 ends the stream of its data set: the document says so ("Set data rate to zero to disable
broadcast and pull a single packet"), and so does the vendor's code, where a single request replaces the broadcast of
the same port, data set, size and offset. So a streaming data set is not requested at all: its next packet is awaited.
Streams are known from DID_RMC and, for data sets without a bit there, by listening: during the transaction, and for
`OBSERVE_S` before the first request of a streamable data set. A slower stream without a bit is not detected.

A transaction that starts and stops streams itself is not corrected: its changes stay.

After a restart, what ran on the device is started again without storing it:

    before   streams and sentences of this port, as found
    restart  SAVE_FLASH, SOFTWARE_RESET: the device comes back with the streams that are stored
    after    GET_DATA with its period for each stream found, the sentences; STOP for stored streams that did not run

SAVE_PERSISTENT_MESSAGES would store streams without a request: it is a command of its own, and an option of the
streams.

Source: ISB document, "Data source update rates", "Persistent Messages", "Get Data Command";
inertial-sense-sdk 2.7.1, com_manager.cpp, getDataRequest.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from imuscope.protocols.commands.transactions import (
    Act,
    DeviceRejectedError,
    NoReplyError,
    PutBack,
    Send,
    T,
    Transaction,
    TransactionCancelledError,
    WaitFor,
)
from imuscope.protocols.events import Batch, Event, Reply, Text
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.commands import NMEA_PERIODS, RMC, SAVE_FLASH, SOFTWARE_RESET, SYS_CMD
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.encoder import GPX_RMC, set_frames, streams_frames
from imuscope.protocols.isb.frames import (
    ACK,
    GET_DATA,
    NACK,
    SET_DATA,
    STOP_ALL_PORTS,
    STOP_CURRENT_PORT,
    STOP_DID,
    TYPE_MASK,
)
from imuscope.protocols.isb.messages import COMMANDS, ROWS
from imuscope.protocols.isb.stored_settings import STREAMS_SETTING
from imuscope.protocols.isb.stream_discovery import ObservedStreams, Requester
from imuscope.protocols.isb.streams import DEFAULT_MS, STREAMS, dids_of

PREAMBLE = bytes((frames.FIRST, frames.SECOND))
OBSERVE_S = 0.25
PASSIVE_S = 5.0  # for the next packet of a stream, instead of an answer
ANSWER_S = 0.3
BACK_TRIES = 2


def undisturbed(body: Transaction[T], request: Requester) -> Transaction[T]:
    """`body`, then the restart of streams that it must not have ended.

    Args:
        request: reads a data set.
    """
    watch = _Watch(request)
    answer: Any = None
    error: BaseException | None = None
    while True:
        try:
            act = body.send(answer) if error is None else body.throw(error)
        except StopIteration as end:
            result: T = end.value
            break
        except DeviceRejectedError:
            yield from watch.restore()
            raise
        answer, error = None, None
        try:
            answer = yield from watch.do(act)
        except TransactionCancelledError as stopped:
            yield from watch.restore_at_once()
            error = stopped
        except Exception as thrown:
            error = thrown
    yield from watch.restore()
    return result


class _Watch:
    """Streams at the start, and data sets requested although they stream."""

    def __init__(self, request: Requester) -> None:
        self._request = request
        self._received = ObservedStreams(set())
        self._observed = False
        self._listed: set[int] = set()  # in DID_RMC
        self._started: dict[int, int] = {}  # by the body: data set → multiple
        self._answers: Counter[int] = Counter()  # requested packets, which are not part of a stream
        self._mute: set[int] = set()  # data sets of whose stream nothing came in time
        self._waiting = -1  # the data set whose stream replaces the request
        self._requested: set[int] = set()  # although they stream
        self._disturbed = False

    def do(self, act: Act) -> Transaction[Any]:
        """Run one act of the body, or its replacement."""
        if isinstance(act, Send):
            return (yield from self._send(act))
        if not isinstance(act, WaitFor):
            return (yield act)
        did, self._waiting = self._waiting, -1
        timeout_s = max(act.timeout_s, PASSIVE_S) if did >= 0 else act.timeout_s
        answer = yield replace(act, match=self._is_receiving(act.match), timeout_s=timeout_s)
        if did >= 0 and answer is None:
            self._mute.add(did)
        return answer

    def _is_receiving(self, match: Callable[[Event], Any]) -> Callable[[Event], Any]:
        def both(event: Event) -> Any:
            self._received.only(event)
            return match(event)

        return both

    def _send(self, act: Send) -> Transaction[None]:
        did = _single(act.frame)
        if did is None:
            self._record(act.frame)
            yield act
            return
        yield from self._check()
        if self._streams(did):
            if did not in self._mute:
                self._waiting = did
                return
            self._requested.add(did)
            self._disturbed = True
            yield PutBack(tuple(self._restart(one) for one in sorted(self._requested)))
        self._answers[did] += 1
        yield act

    def _check(self) -> Transaction[None]:
        if self._observed:
            return
        self._observed = True
        yield WaitFor(self._is_receiving(lambda _: None), OBSERVE_S, "streams")
        try:
            self._listed = set(dids_of((yield from self._request(RMC)).get("bits", 0)))
        except (DeviceRejectedError, NoReplyError):  # a GPX has another; for a silent one the body raises
            return

    def _streams(self, did: int) -> bool:
        return did in self._listed or did in self._started or self._received.count(did) > 1 + self._answers[did]

    def _record(self, packet: bytes) -> None:
        """Note streams that the body starts and stops on purpose."""
        kind = packet[2] & TYPE_MASK if packet[:2] == PREAMBLE else -1
        if kind == GET_DATA:
            did, period = (int.from_bytes(packet[at : at + 2], "little") for at in (6, 12))
            self._forget(did)
            if period:
                self._started[did] = period
        elif kind == STOP_DID:
            self._forget(packet[3])
        elif kind in (-1, STOP_ALL_PORTS, STOP_CURRENT_PORT) or (kind == SET_DATA and packet[3] in (RMC, SYS_CMD)):
            for did in STREAMS:
                self._forget(did)
            self._observed = False  # a sentence may stop everything, too

    def _forget(self, did: int) -> None:
        self._listed.discard(did)
        self._started.pop(did, None)
        self._requested.discard(did)
        self._mute.discard(did)
        self._received.forget(did)
        self._answers.pop(did, None)

    # -- afterwards

    def restore(self) -> Transaction[None]:
        """Restart streams that were requested and no longer run; checked once more. A device that does not answer is
        not back.
        """
        answers = True
        for _ in range(BACK_TRIES if self._requested else 0):
            for did in sorted(self._requested):
                is_over = yield from self._is_over(did)
                answers = is_over is not None
                if is_over is False:
                    self._requested.discard(did)
                    continue
                yield Send(self._restart(did))
        if self._disturbed and answers:
            yield PutBack()

    def restore_at_once(self) -> Transaction[None]:
        """Restart, without waiting, every stream that was requested although it streamed."""
        for did in sorted(self._requested):
            yield Send(self._restart(did))

    def _restart(self, did: int) -> bytes:
        return frames.get_data(did, period=self._period(did))

    def _is_over(self, did: int) -> Transaction[bool | None]:
        """Whether it has stopped streaming; None if the device does not answer."""
        if STREAMS[did].rmc_bit >= 0:
            try:
                return did not in dids_of((yield from self._request(RMC)).get("bits", 0))
            except DeviceRejectedError:
                return False
            except NoReplyError:
                return None
        wait_s = max(ANSWER_S, 3e-3 * (self._received.interval_ms(did) or 0))
        return not (yield WaitFor(lambda event: _is(event, did), wait_s, "streams", is_answer=True))

    def _period(self, did: int) -> int:
        """Its multiple; 1 if never observed."""
        if did in self._started:
            return self._started[did]
        interval, base = self._received.interval_ms(did), DEFAULT_MS[STREAMS[did].pace]
        return max(1, round(interval / base)) if interval and base else 1


def _is(event: Event, did: int) -> bool | None:
    observed = ObservedStreams(set())
    observed.only(event)
    return True if did in observed.sizes else None


def _single(packet: bytes) -> int | None:
    """The data set of which a packet requests one value, if it can stream."""
    if packet[:2] != PREAMBLE or packet[2] & TYPE_MASK != GET_DATA:
        return None
    did, period = (int.from_bytes(packet[at : at + 2], "little") for at in (6, 12))
    return did if did in STREAMS and not period else None


RESTART = (SAVE_FLASH, SOFTWARE_RESET)
SENTENCES = SETS[NMEA_PERIODS].name
WORDS = (
    "The device saves this configuration and restarts so that it takes effect; it sends nothing for about two seconds. "
    "The streams of this port are then started again; they are not stored. On its other ports only stored streams "
    "run again."
)


def frames_of(values: Mapping[str, Mapping[str, Any]], version: str) -> list[bytes]:
    """The frames that start these streams and sentences on this port."""
    streams = values.get(STREAMS_SETTING, {}).get("streams", [])
    sentences = values.get(SENTENCES, {}).get("nmeaBroadcastMsgs", [])
    packets = streams_frames({"streams": streams})
    if any(one["msgID"] and one["msgPeriod"] for one in sentences):
        values_sent = {"options": 0, "nmeaBroadcastMsgs": sentences}
        packets += set_frames(NMEA_PERIODS, values_sent, version, held=True)
    return packets


def resume(packets: Sequence[bytes], request: Requester, *, gpx: bool) -> Transaction[None]:
    """Start what ran, end stored streams that did not run."""
    for packet in packets:
        yield Send(packet)
    running = {_did(packet) for packet in packets if packet[2] & TYPE_MASK == GET_DATA}
    with suppress(DeviceRejectedError, NoReplyError):
        rmc = yield from request(GPX_RMC if gpx else RMC)
        for did in dids_of(rmc.get("bits", 0), gpx=gpx):
            if did not in running:
                yield Send(frames.build(frames.STOP_DID, did))
    yield PutBack()


def confirms(packet: bytes, event: Event) -> bool:
    """Whether a stream that was requested has come, or is refused; or a sentence, which nothing else starts."""
    if packet[2] & TYPE_MASK != GET_DATA:
        return isinstance(event, Text) or (isinstance(event, Reply) and event.message is COMMANDS[ACK])
    did = _did(packet)
    if isinstance(event, Reply) and event.message is COMMANDS[NACK]:
        return bool(event.values.get("body.dataHdr.id") == did)
    return isinstance(event, Batch | Reply) and event.message is ROWS.get(did)


def _did(packet: bytes) -> int:
    """The data set that a packet requests."""
    return int.from_bytes(packet[6:8], "little")
