"""Driver of an MTi: tables, frames and transactions of section 5.3, behind `transactions.DeviceDriver`.

    within(body)    GoToConfig … body … GoToMeasurement, also when the body fails or is stopped
    read(setting)   its request; the answer's fields
    write(setting)  its Set message, the acknowledgement, then the request: the value really stored
    restart         Reset; the device stores settings when they are set

Values are wire values by field name. Two settings differ from their message: OptionFlags is the desired word, sent as
the flags to set and those to clear; AlignmentRotation is two settings, the parameter being part of the name. An empty
list of outputs, or of sync settings, is sent as one entry that means "none".

A device on a shared line is addressed by its bus identifier (`DeviceContext.device`) in all messages.

Source: MT0101P 2020.A; the entry that means no CAN outputs from the vendor's public code.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from imuscope.protocols.commands.transactions import (
    AT_REST,
    ByteRange,
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    LinkLoad,
    NoReplyError,
    PutBack,
    ReopenLink,
    RequiresState,
    Send,
    Transaction,
    TransactionCancelledError,
    Values,
    WaitFor,
    WriteResult,
)
from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.schema import validation
from imuscope.protocols.schema.fields import Command, Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.xbus import annotate, commands, config_effects, frames, requests
from imuscope.protocols.xbus.bandwidth import fit, load, message_rate
from imuscope.protocols.xbus.commands import CommandRow, StoredSetting
from imuscope.protocols.xbus.device_info import formerly, identity
from imuscope.protocols.xbus.enums import OPTION_FLAGS
from imuscope.protocols.xbus.json_codec import frame_from_json
from imuscope.protocols.xbus.product_options import problems_beyond
from imuscope.protocols.xbus.products import Model, model_of

T = TypeVar("T")

_NONE: Mapping[str, tuple[str, dict[str, int]]] = {  # encoding of an empty list, since an empty message is a request
    "SetOutputConfiguration": ("outputs", {"data_identifier": 0, "output_frequency": 0}),
    "SetSyncSettings": (
        "settings",
        dict.fromkeys(("function", "line", "polarity", "trigger_once", "skip_first", "skip_factor", "pulse_width"), 0)
        | {"delay_offset_or_clock_period": 0},
    ),
    "SetCanOutputConfig": ("outputs", dict.fromkeys(("can_data_id", "frame_format", "can_id", "frequency"), 0)),
}
_STORE_RESET = frame_from_json({"message": "ResetOrientation", "fields": {"code": 0}})
_OPTION_MASK = sum(1 << bit.low for bit in OPTION_FLAGS)


class XbusDriver(DeviceDriver):
    """See imuscope.protocols.commands.transactions.DeviceDriver.

    Args:
        times: how long a device is waited for.
    """

    name = "xbus"
    states: Mapping[str, str] = {
        "GoToConfigAck": AT_REST,
        "GoToMeasurementAck": "Measurement",
        "MTData2": "Measurement",
    }
    begins: Collection[str] = ("GoToMeasurementAck", "WakeUp")
    ends_rest = "GoToMeasurement"

    def __init__(self, times: requests.StateTimes | None = None) -> None:
        self._times = times or requests.StateTimes()

    # -- tables

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        return commands.commands(known.product)

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        return commands.settings(known.product)

    def lacking_rules(self, known: DeviceContext) -> str:
        if not known.product or model_of(known.product) is not None:
            return ""
        return f"No rules for {known.product}: everything of the MTi family is offered, and it refuses what it lacks."

    # -- frames

    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        model = model_of(known.product)
        row = _row(command, values, model)
        return frames.to_bus(_frame(row, values, model), _bus(known))

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        model = model_of(known.product)
        frame = _write_frame(_stored_setting(setting, model), values, model, held=held, old=old)
        return [frames.to_bus(frame, _bus(known))]

    def command_frames(self, command: str, values: Values, known: DeviceContext) -> list[bytes]:
        sent = [self.frame(command, values, known)]
        if _row(command, values, model_of(known.product)).name == commands.RESET_AND_STORE:
            sent.append(frames.to_bus(_STORE_RESET, _bus(known)))
        return sent

    def annotate(self, frame: bytes) -> list[ByteRange]:
        return annotate.annotate(frame)

    def name_of(self, frame: bytes) -> str:
        return annotate.name_of(frame)

    # -- transactions

    def within(self, body: Transaction[T], known: DeviceContext) -> Transaction[T]:
        return requests.addressed(self._within(body, at_rest=known.at_rest, sample_s=known.sample_s), _bus(known))

    def _within(self, body: Transaction[T], *, at_rest: bool = False, sample_s: float = 0.0) -> Transaction[T]:
        """`body` in the config state, or in its required state (RequiresState), then in the state in which the device
        was found: it measures again unless it was at rest.
        """
        state = body.state if isinstance(body, RequiresState) else "config"
        if state == "any":
            return (yield from body)
        if state == "measuring":
            if not (yield WaitFor(requests.sample, requests.FIRST_SAMPLE_S)):  # it measures; GoToMeasurement would fail
                yield from requests.to_measurement()
            return (yield from body)
        continues = isinstance(body, RequiresState) and body.continues  # then nothing may come in between
        if not at_rest and not continues:
            at_rest = yield from requests.is_in_config(sample_s)
        if not at_rest:
            yield PutBack((frames.build(requests.GO_TO_MEASUREMENT),))
        try:
            yield from requests.to_config(self._times)
            result = yield from body
        except TransactionCancelledError:  # also before the body: the device may have received GoToConfig already
            if not at_rest:
                yield Send(frames.build(requests.GO_TO_MEASUREMENT), "GoToMeasurement")
            raise
        except Exception:  # also before the body: an answer may have been lost, and the device be silent
            if not at_rest and (yield from _measure_again()):
                yield PutBack()
            raise
        if not at_rest:
            yield from requests.to_measurement()
            yield PutBack()
        return result

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Run one command, without retries if it must not run twice. The state in which it runs is declared."""
        model = model_of(known.product)
        row = _row(command, values, model)
        frame = _frame(row, values, model)
        body = self._reset_and_store(frame) if row.name == commands.RESET_AND_STORE else _run(row, frame, self._times)
        return RequiresState(
            requests.addressed(body, _bus(known)), commands.state_of(row, values), continues=commands.continues(row)
        )

    def _reset_and_store(self, frame: bytes) -> Transaction[Values]:
        """While measuring: the reset, the config state, the code that stores, measurement, with nothing between
        them.
        """
        yield from requests.send_request(frame, "ResetOrientation", 0.5, 1)
        store = requests.send_request(_STORE_RESET, "ResetOrientation", 0.5)
        return (yield from self._within(RequiresState(store, "config", continues=True)))

    def unfinished(self, command: str, values: Values) -> str | None:
        return commands.unfinished(command, values)

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        return commands.alters(command, values, model_of(known.product))

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        return (yield from requests.addressed(_read(_stored_setting(setting, model_of(known.product))), _bus(known)))

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        return requests.addressed(self._write(setting, values, known, held), _bus(known))

    def _write(self, setting: str, values: Values, known: DeviceContext, held: bool) -> Transaction[WriteResult]:
        model = model_of(known.product)
        one = _stored_setting(setting, model)
        row = commands.write_row(one, model)
        assert row is not None  # _write_frame raises otherwise
        try:
            yield from requests.send_request(_write_frame(one, values, model, held=held), row.message, row.timeout_s)
        except DeviceRejectedError as refused:
            return WriteResult(setting, values, refused=refused.why)
        return WriteResult(setting, values, (yield from _read(one)))

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        return requests.addressed(self._identify(known), _bus(known))

    def _identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        """Query product, serial number and firmware; enters the config state if needed."""
        try:
            first = yield from _identity("ReqDID")
        except DeviceRejectedError:
            return (yield from self._within(self._identify(known), at_rest=known.at_rest, sample_s=known.sample_s))
        identity = dict(first)
        for request in ("ReqProductCode", "ReqFWRev"):
            identity |= yield from _identity(request)
        return replace(
            known,
            product=identity.get("product", known.product),
            serial_number=identity.get("serial_number", known.serial_number),
            firmware=identity.get("firmware", known.firmware),
        )

    formerly = staticmethod(formerly)
    line_change = staticmethod(config_effects.line_change)
    own_ports = staticmethod(config_effects.own_ports)
    rates = staticmethod(config_effects.rates)
    instead = staticmethod(config_effects.instead)

    def restart_frames(self, values: Mapping[str, Values], known: DeviceContext) -> list[bytes]:
        return [frames.to_bus(frames.build(requests.RESET), _bus(known))]

    def store_and_restart(self, known: DeviceContext) -> Transaction[Sequence[bytes]]:
        """Reset; written settings are stored already. Not inside `within`: the device then measures by itself."""
        reset = requests.send_request(frames.build(requests.RESET), "Reset", 0.5)
        yield from requests.addressed(reset, _bus(known))
        return ()

    def takes_writes(self, known: DeviceContext) -> Transaction[bool]:
        return requests.addressed(requests.is_in_config(known.sample_s), _bus(known))

    def confirms(self, frame: bytes, event: Event) -> bool:
        if isinstance(event, Reply) and event.message.id == requests.ERROR:
            return event.values.get("code") == requests.ERROR_MESSAGE  # it measures already
        return isinstance(event, Batch | Reply) and self.states.get(event.message.name) == "Measurement"

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        return (yield from requests.addressed(requests.is_alive(self._times), _bus(known)))

    def restore_communication(self, known: DeviceContext) -> Transaction[bool]:
        """Section 7.2, at 115 200 Bd. True: the device has the factory's communication settings, and measures."""
        if not (yield ReopenLink(requests.RESTORE_BAUD)):
            return False
        if not (yield from requests.addressed(requests.restore_communication(self._times), _bus(known))):
            return False
        yield from requests.addressed(_measure_again(), _bus(known))
        return True

    # -- derived from settings

    def load(self, settings: Mapping[str, Values], known: DeviceContext) -> LinkLoad:
        return load(settings, model_of(known.product))

    def message_rate(self, settings: Mapping[str, Values], known: DeviceContext) -> float | None:
        return message_rate(settings, model_of(known.product))

    def fit_rates(self, settings: Mapping[str, Values], capacity: float, known: DeviceContext) -> Mapping[str, Values]:
        return fit(settings, capacity, model_of(known.product))

    def factory(self, known: DeviceContext) -> Mapping[str, Values]:
        return config_effects.factory(model_of(known.product))

    same = staticmethod(config_effects.differing)


def _bus(known: DeviceContext) -> int:
    """The bus identifier of its messages: 255, which a device alone on its line accepts."""
    return int(known.device) if known.device else frames.MASTER


# -- rows by name ------------------------------------------------------------------------------------------------------


def _row(command: str, values: Values, model: Model | None) -> CommandRow:
    """The row of a command; with two forms and an unknown product, the one that these values fit."""
    rows = commands.rows(model)
    if command not in rows:
        whose = f"{model.name} has no command" if model else "no command is called"
        raise EncodeError(f"{whose} {command!r}")
    forms = [row for row in rows.values() if (row.name or row.message) == command]
    fits = (row for row in forms if not any(validation.find_problems(commands.arguments(row, model), values)))
    return next(fits, rows[command])


def _stored_setting(setting: str, model: Model | None) -> StoredSetting:
    row = commands.stored_settings(model).get(setting)
    if row is None:
        whose = f"{model.name} has no setting" if model else "no setting is called"
        raise EncodeError(f"{whose} {setting!r}")
    return row


# -- values → frames ---------------------------------------------------------------------------------------------------


def _frame(
    row: CommandRow, values: Values, model: Model | None, *, held: bool = False, old: Values | None = None
) -> bytes:
    """The frame of a command.

    Args:
        held: values read from the device itself, which are written back unchecked.
        old: values that the device reports, which need not be in the tables.

    Raises:
        EncodeError: a value is missing, unknown, out of its range, or does not go with the others.
    """
    if not held:
        validation.require_valid(commands.arguments(row, model), values)
        for problem in problems_beyond(row.message, values, model, old):
            raise EncodeError(problem.message, problem.path)
    if row.message in _NONE and not values[_NONE[row.message][0]]:
        name, nothing = _NONE[row.message]
        values = {name: [nothing]}
    return frame_from_json({"message": row.message, "fields": dict(values)})


def _write_frame(
    one: StoredSetting, values: Values, model: Model | None, *, held: bool = False, old: Values | None = None
) -> bytes:
    row = commands.write_row(one, model)
    if row is None:
        raise EncodeError(f"{one.name} is reported by the device and cannot be written")
    fields = {name: value for name, value in values.items() if name not in one.read_only_fields}
    if one.name == "OptionFlags":
        if not held:
            validation.require_valid(commands.reply_form(one.read, model).fields, fields)
        flags = int(fields["flags"])
        fields = {"set_flags": flags, "clear_flags": _OPTION_MASK & ~flags}
    fields = {**fields, **one.fixed}
    return _frame(_row(row.message, fields, model), fields, model, held=held, old=old)


def read_frame(one: StoredSetting) -> bytes:
    """The frame that requests a setting."""
    return frame_from_json({"message": one.read, "fields": dict(one.fixed)})


# -- transactions ------------------------------------------------------------------------------------------------------


def _run(row: CommandRow, frame: bytes, times: requests.StateTimes) -> Transaction[Values]:
    if row.message == "WakeUpAck":
        yield Send(frame, row.message)
        return {}
    if row.message == "ReqData":
        return (yield from _one_sample(frame, row))
    if row.message == "GoToMeasurement":
        yield from requests.to_measurement()
        return {}
    if row.message == "GoToConfig":
        yield from requests.to_config(times)
        return {}
    attempts = 1 if row.kind == "do" else requests.MAX_ATTEMPTS
    return (yield from requests.send_request(frame, row.message, row.timeout_s, attempts))


def _one_sample(frame: bytes, row: CommandRow) -> Transaction[Values]:
    """Request a sample. A streaming device sends samples anyway; its refusal is an Error a moment later."""
    yield Send(frame, row.message)
    came = yield WaitFor(_sample_or_error, row.timeout_s, "MTData2", is_answer=True)
    if came is None:
        raise NoReplyError(row.message, 1, row.timeout_s)
    if came is True:
        came = yield WaitFor(_error, requests.REFUSED_S)
    if isinstance(came, Reply):
        raise requests.refusal(row.message, came)
    return {}


def _sample_or_error(event: Event) -> bool | Reply | None:
    return requests.sample(event) or _error(event)


def _error(event: Event) -> Reply | None:
    return event if isinstance(event, Reply) and event.message.id == requests.ERROR else None


def _read(one: StoredSetting) -> Transaction[Values]:
    def accept(reply: Reply) -> bool:
        if one.fixed:
            return bool(reply.values.get("parameter") == one.fixed["parameter"])
        return bool(reply.values) or one.name in ("SyncSettings", "CanOutputConfig", "OutputConfiguration")

    row = next(row for row in commands.rows(None).values() if row.message == one.read)
    values = yield from requests.send_request(read_frame(one), one.read, row.timeout_s, accept=accept)
    if one.only:
        return {name: values[name] for name in one.only}
    if not values:  # an empty list
        return {commands.reply_form(one.read, None).fields[0].name: []}
    if one.name in ("OutputConfiguration", "CanOutputConfig"):
        return {"outputs": [entry for entry in values["outputs"] if any(entry.values())]}
    return values


def _identity(request: str) -> Transaction[dict[str, str]]:
    number = {"ReqDID": 0x00, "ReqProductCode": 0x1C, "ReqFWRev": 0x12}[request]
    received: list[Reply] = []

    def accept(reply: Reply) -> bool:
        received.append(reply)
        return True

    yield from requests.send_request(frames.build(number), request, 0.5, accept=accept, may_refuse=request == "ReqDID")
    return dict(identity(received[-1]))


def _measure_again() -> Transaction[bool]:
    """Try to measure after a failure; whether the device answered. The first failure is the one reported."""
    try:
        yield from requests.to_measurement()
    except DeviceRejectedError:
        return True
    except NoReplyError:
        return False
    return True
