"""Requests to an MTi: state changes, attempts and acknowledgements.

    ask      request ──> acknowledgement, number plus one; Error ──> DeviceRejectedError in the document's words;
                   WakeUp ──> DeviceRestartedError (only Reset is answered by it too);
                   no answer within the time-out ──> retry, if repeating is harmless
    is_in_config   ReqDID: a device in the config state answers, one that measures refuses or answers as well; then a
                   sample after the answer outweighs it
    to_config      GoToConfig every 100 ms; a WakeUp in between is answered with WakeUpAck at once: within 500 ms that
                   also leads to the config state. A device that ignores both is left as it is: only Reset, which the
                   user sends, may help
    to_measurement GoToMeasurement, its acknowledgement; a device that already measures refuses, which is accepted
    addressed      the same, to one of the devices on a shared line: each answers to its own bus identifier only

A late answer can be mistaken for that of the next request of the same number; so a request for values does not accept
an empty acknowledgement, and one for an alignment only its own.

Source: MT0101P 2020.A, 5.2 and 5.3.1; that some devices answer only after Reset is known from their users.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from imuscope.protocols.commands.transactions import (
    DeviceRejectedError,
    DeviceRestartedError,
    NoReplyError,
    PutBack,
    Send,
    Sleep,
    T,
    Transaction,
    WaitFor,
)
from imuscope.protocols.events import Batch, Event, Reply, Text
from imuscope.protocols.schema.json_values import jsonable
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.messages import answers

REQ_DID, GO_TO_CONFIG, GO_TO_MEASUREMENT, RESET = 0x00, 0x30, 0x10, 0x40
WAKE_UP, WAKE_UP_ACK, ERROR = 0x3E, 0x3F, 0x42
ERROR_MESSAGE = 4

MAX_ATTEMPTS = 3
STEP_S = 0.1  # between two GoToConfig
ANSWER_S = 0.2  # an answer to ReqDID has come by then, after samples under way
FIRST_SAMPLE_S = 0.25  # a measuring device has sent something by then, unless it is slow or waits for a trigger
SLOWEST_SAMPLE_S = 2.5  # of a device at 1 Hz
REFUSED_S = 0.2  # a refusing Error has come by then, after samples under way
RESTORE_BYTE, RESTORE_BAUD, RESTORE_GAP_S, RESTORE_S = b"\xde", 115_200, 0.0003, 60.0

NO_RESET = "The device was not restarted: run the command Reset if that is what you want."

Plain = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class StateTimes:
    """Time limits of state changes and of the search for a device, s. Tests of silent devices pass shorter ones.

    Args:
        config_s: how long GoToConfig is repeated; a device that is restarting takes up to 1.7 s.
        stream_s: for a first frame of a device that streams.
        answer_s: for the answer to each request to a device that may not be there.
    """

    config_s: float = 2.0
    stream_s: float = 1.0
    answer_s: float = 0.4


def addressed(transaction: Transaction[T], bid: int) -> Transaction[T]:
    """A transaction whose frames all go to this bus identifier."""
    if bid == frames.MASTER:
        return (yield from transaction)
    try:
        act = next(transaction)
        while True:
            if isinstance(act, Send):
                act = replace(act, frame=frames.to_bus(act.frame, bid))
            elif isinstance(act, PutBack):
                act = PutBack(tuple(frames.to_bus(one, bid) for one in act.frames))
            try:
                answer = yield act
            except Exception as thrown:  # the transaction is stopped: it may yield final frames
                act = transaction.throw(thrown)
            else:
                act = transaction.send(answer)
    except StopIteration as end:
        result: T = end.value
        return result


def send_request(
    frame: bytes,
    what: str,
    timeout_s: float,
    attempts: int = MAX_ATTEMPTS,
    accept: Callable[[Reply], bool] = lambda reply: True,
    *,
    may_refuse: bool = False,
) -> Transaction[Plain]:
    """Send a request until it is acknowledged.

    Args:
        may_refuse: as of WaitFor.

    Returns:
        The acknowledgement's fields, wire values.

    Raises:
        DeviceRejectedError: Error came instead.
        DeviceRestartedError: WakeUp came instead.
        NoReplyError: no answer.
    """
    number = answers(frame[2])

    def match(event: Event) -> Reply | None:
        if not isinstance(event, Reply):
            return None
        if event.message.id in (ERROR, WAKE_UP) or (event.message.id == number and accept(event)):
            return event
        return None

    for _ in range(attempts):
        yield Send(frame, what)
        reply = yield WaitFor(match, timeout_s, what, is_answer=True, may_refuse=may_refuse)
        if reply is not None:
            if reply.message.id == ERROR:
                raise refusal(what, reply)
            if reply.message.id == WAKE_UP and frame[2] != RESET:
                raise DeviceRestartedError(what)
            return values_of(reply)
    raise NoReplyError(what, attempts, timeout_s)


def values_of(reply: Reply) -> Plain:
    """Its fields as `imuscope inspect` prints them."""
    values: Plain = jsonable(dict(reply.values))
    return values


def refusal(what: str, error: Reply) -> DeviceRejectedError:
    """An Error message in words."""
    code = int(error.values["code"])
    field = error.message.fields[0]
    why = field.choices.get(code, f"error {code}")
    if "device_error" in error.values:
        detail = int(error.values["device_error"])
        why += f" ({error.message.fields[1].choices.get(detail, detail)})"
    return DeviceRejectedError(what, why, code)


# -- states ------------------------------------------------------------------------------------------------------------


def is_in_config(sample_s: float = 0.0) -> Transaction[bool]:
    """Whether the device is in the config state already; False if it does not answer.

    Args:
        sample_s: time between the samples that it sent before; 0 if not known.
    """
    yield Send(frames.build(REQ_DID), "ReqDID")
    message = yield WaitFor(_did_or_refusal, ANSWER_S, "ReqDID", is_answer=True, may_refuse=True)
    if message == WAKE_UP:  # it is starting, and would measure
        yield Send(frames.build(WAKE_UP_ACK), "WakeUpAck")
    if message != REQ_DID + 1:
        return False
    wait_s = min(max(FIRST_SAMPLE_S, 2 * sample_s), SLOWEST_SAMPLE_S)
    return not (yield WaitFor(sample, wait_s, "a sample"))


def sample(event: Event) -> bool | None:
    """Match a sample, which only a measuring device sends."""
    return True if isinstance(event, Batch) and event.message.name == "MTData2" else None


def _did_or_refusal(event: Event) -> int | None:
    replies = (REQ_DID + 1, ERROR, WAKE_UP)
    return event.message.id if isinstance(event, Reply) and event.message.id in replies else None


def to_config(times: StateTimes) -> Transaction[None]:
    """Bring the device to the config state. It is never restarted for that.

    Raises:
        NoReplyError: no answer.
    """
    if not (yield from _insist(times.config_s)):
        raise NoReplyError("GoToConfig", round(times.config_s / STEP_S), STEP_S, NO_RESET)


def _insist(patience_s: float, *, is_awake: bool = False) -> Transaction[bool]:
    """Send GoToConfig every 100 ms; a device that wakes up in between is kept in the config state.

    Args:
        is_awake: the device has just spoken, so it answers at once.
    """
    for _ in range(round(patience_s / STEP_S)):
        yield Send(frames.build(GO_TO_CONFIG), "GoToConfig")
        message = yield WaitFor(_config_or_awake, STEP_S, "GoToConfig", is_answer=is_awake)
        if message == GO_TO_CONFIG + 1:
            return True
        if message == WAKE_UP:
            yield Send(frames.build(WAKE_UP_ACK), "WakeUpAck")
    return False


def _config_or_awake(event: Event) -> int | None:
    replies = (GO_TO_CONFIG + 1, WAKE_UP)
    return event.message.id if isinstance(event, Reply) and event.message.id in replies else None


def to_measurement() -> Transaction[None]:
    """Bring the device to the measurement state.

    Raises:
        DeviceRejectedError, NoReplyError: it fails.
    """
    try:
        yield from send_request(frames.build(GO_TO_MEASUREMENT), "GoToMeasurement", 0.5, may_refuse=True)
    except DeviceRejectedError as refused:
        if refused.code != ERROR_MESSAGE:
            raise


def is_alive(times: StateTimes) -> Transaction[bool]:
    """Whether a device answers at the present rate. At most three seconds, two of them while it may restart."""
    if (yield WaitFor(_speaks, times.stream_s)):
        return True
    for _ in range(4):
        yield Send(frames.build(0x00), "ReqDID")  # refused while measuring, which is an answer too
        if (yield WaitFor(_speaks, times.answer_s, may_refuse=True)):
            return True
    yield Send(frames.build(GO_TO_CONFIG), "GoToConfig")
    if not (yield WaitFor(_speaks, times.answer_s)):
        return False
    yield Send(frames.build(GO_TO_MEASUREMENT), "GoToMeasurement")
    yield WaitFor(_speaks, times.answer_s, may_refuse=True)
    return True


def _speaks(event: Event) -> bool | None:
    """Match any valid frame or sentence: at a wrong rate there is none."""
    return True if isinstance(event, (Batch, Reply, Text)) else None


def restore_communication(times: StateTimes) -> Transaction[bool]:
    """Section 7.2: repeat 0xDE, with gaps, until a device that is powered on now sends WakeUp."""
    sent = 0.0
    while sent < RESTORE_S:
        yield Send(RESTORE_BYTE, "restore communication")
        if (yield WaitFor(_awake, RESTORE_GAP_S, "WakeUp")):
            yield Send(frames.build(WAKE_UP_ACK), "WakeUpAck")
            yield Sleep(STEP_S)
            return (yield from _insist(times.config_s, is_awake=True))
        sent += RESTORE_GAP_S
    return False


def _awake(event: Event) -> bool | None:
    return True if isinstance(event, Reply) and event.message.id == WAKE_UP else None
