"""Command exchanges without I/O: requests, waits, retries and refusals.

A transaction is a generator. It yields actions and is sent their results; it never sleeps, reads or writes by itself,
so a test plays it with a list and the server runs it on a link:

    def ask(frame):                          the runner
        yield Send(frame, "ReqDID")          writes the bytes, sends None
        values = yield WaitFor(did, 0.5)     passes every event to `did` until it returns a value, sends that;
                                             sends None on time-out
        return values                        has the result of the transaction

    yield Sleep(0.1)                         waits, sends None
    yield ReopenLink(baud=921600)            closes the link and opens it at that rate, sends True; False: it failed
    yield Note("It is restarted.")           informs observers of what no frame shows, sends None

A device's refusal is a `DeviceRejectedError`, its silence a `NoReplyError`; both name the request, for the page. To
stop a transaction, a runner calls `cancel(transaction)` and writes the frames that it returns (GoToMeasurement after a
browser has gone). Not `close()`: a generator that is being closed may not yield any more.

A body given to `DeviceDriver.within` runs in the state in which settings are read and written, unless it requires
another (`RequiresState`): some commands make sense only while the device measures.

`DeviceDriver` is a protocol's knowledge about configuring its devices; protocols/registry/families.py has one for each.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.schema.fields import Caution, Command, Setting
from imuscope.protocols.schema.layouts import EncodeError

T = TypeVar("T")
NO_STATES: Mapping[str, str] = {}
AT_REST = "Config"  # of `DeviceDriver.states`: a device that the user sent there stays in it
Values = Mapping[str, Any]
"""Wire values by field name, as `imuscope inspect` prints them: integers for choices and flag words, lists, records as
objects, bytes as hex."""


@dataclass(frozen=True, slots=True)
class Send:
    """Write these bytes. `what` names them if the protocol's own listing cannot."""

    frame: bytes
    what: str = ""


@dataclass(frozen=True, slots=True)
class WaitFor:
    """Wait for an event for which `match` returns a value; None after `timeout_s`.

    Args:
        is_answer: the device answers at once to the bytes just sent, so only its silence takes the time: a runner on a
            slow machine may give it longer.
        may_refuse: a refusal answers the question as well (a device that measures says so by it): no failure.
    """

    match: Callable[[Event], Any | None]
    timeout_s: float
    what: str = ""
    is_answer: bool = False
    may_refuse: bool = False


@dataclass(frozen=True, slots=True)
class Sleep:
    """Wait, seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class ReopenLink:
    """Close the link and open it again, optionally at another rate; bytes arriving afterwards are decoded afresh."""

    baud: int | None = None


@dataclass(frozen=True, slots=True)
class Note:
    """Inform observers with a sentence that the frames do not contain (a device is restarted, and why)."""

    words: str


@dataclass(frozen=True, slots=True)
class PutBack:
    """Store the frames that put the device back into the state in which it was found, in case this process ends before
    the transaction does; none: it is back.
    """

    frames: tuple[bytes, ...] = ()


Act = Send | WaitFor | Sleep | ReopenLink | Note | PutBack
Transaction = Generator[Act, Any, T]


class DeviceRejectedError(Exception):
    """The device refused: `what` was requested and why it failed, in the document's words ("parameter invalid …")."""

    def __init__(self, what: str, why: str, code: int | None = None) -> None:
        super().__init__(f"{what}: {why}")
        self.what, self.why, self.code = what, why, code


class NoReplyError(Exception):
    """No answer to `what` after `attempts` attempts of `timeout_s` each; `advice`: a sentence on what to do."""

    def __init__(self, what: str, attempts: int, timeout_s: float, advice: str = "") -> None:
        super().__init__(f"No answer to {what} ({attempts} attempts of {timeout_s:g} s).{advice and ' ' + advice}")
        self.what, self.attempts, self.timeout_s = what, attempts, timeout_s


class DeviceRestartedError(NoReplyError):
    """The device restarted before it answered to `what`: it is not in the state any more in which it was written."""

    def __init__(self, what: str) -> None:
        super().__init__(what, 1, 0.0)
        self.args = (f"The device restarted before it answered to {what}.",)


class TransactionCancelledError(Exception):
    """Thrown into a transaction to stop it: it may still yield `Send` for required cleanup."""


def cancel(transaction: Transaction[Any]) -> list[Send]:
    """Stop a transaction.

    Returns:
        Frames that the runner must still write, in order; waits are skipped.
    """
    last: list[Send] = []
    try:
        act = transaction.throw(TransactionCancelledError())
        while True:
            if isinstance(act, Send):
                last.append(act)
            act = transaction.send(None)
    except (StopIteration, TransactionCancelledError, DeviceRejectedError, NoReplyError):
        return last


class RequiresState(Generator[Act, Any, T]):
    """A transaction with the required state of the device: "config", "measuring", or "any".

    `DeviceDriver.within` reads it; otherwise it behaves as the transaction itself.

    Args:
        continues: it continues an earlier command (stores a reset, ends a calibration): between the two the device must
            neither restart nor pass through another state.
    """

    def __init__(
        self, transaction: Transaction[T], state: Literal["config", "measuring", "any"], *, continues: bool = False
    ) -> None:
        self._transaction = transaction
        self.state = state
        self.continues = continues

    def send(self, value: Any, /) -> Act:
        return self._transaction.send(value)

    def throw(self, *args: Any) -> Act:
        return self._transaction.throw(*args)


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """Known identity and state of a device; empty if unknown.

    Args:
        baud: present rate of the link; None if it has none.
        device: the addressed one if a link carries several (an IDTP device id, the bus identifier of an MTi).
        settings: of the family's decoder, as far as given (ProtocolInfo.settings): the key of encrypted frames.
        at_rest: the user sent it to the state in which settings are read, and it stays there (`DeviceDriver.within`).
        sample_s: time between its newest samples; 0 if not known.
    """

    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    baud: int | None = None
    device: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict, repr=False, hash=False)
    at_rest: bool = False
    sample_s: float = 0.0


@dataclass(frozen=True, slots=True)
class ByteRange:
    """A few bytes of a frame and their meaning."""

    offset: int
    size: int
    label: str
    path: str = ""  # the field: "outputs.3.output_frequency"; "" for the envelope


@dataclass(frozen=True, slots=True)
class OutputLoad:
    """Bytes and messages per second that one output adds to the link."""

    path: str  # the output in its setting: "outputs.3"; "" for what belongs to none
    title: str
    bytes_per_s: float


@dataclass(frozen=True, slots=True)
class LinkLoad:
    """Bytes per second that outputs need on the line.

    Args:
        parts: one per output; the fixed cost of every message (header, checksum) is the part with path "".
        total: sum of the parts.
        limits: exceeded per-message limits, one sentence each.
    """

    parts: tuple[OutputLoad, ...]
    total: float
    limits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class WriteResult:
    """Outcome of writing one setting.

    Args:
        requested: the values sent.
        actual: the values read back; None if they could not be read.
        refused: why nothing was written, in the document's words; "" if it was written.
    """

    setting: str
    requested: Values
    actual: Values | None = None
    refused: str = ""


@dataclass(frozen=True, slots=True)
class BaudChange:
    """A change that may cut the line.

    Args:
        baud: rate of the line afterwards; None if the rate does not change.
        kind: "baud" (the rate), "port" (it may be off), "protocol" (another language), "silent" (no output).
        words: one sentence for the user.
        others: other possible rates of the device, if it is unknown which port is ours.
    """

    kind: Literal["baud", "port", "protocol", "silent"]
    words: str
    baud: int | None = None
    others: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Risk:
    """Possible harm of a command or a change: its kind, and one sentence for the user."""

    caution: Caution
    consequence: str


class DeviceDriver(ABC):
    """Configuration of a protocol's devices: tables, frames and transactions; no I/O, no state.

    What a family leaves out is that of a device without settings, states and load, whose rate nothing changes.

    Every method with values raises protocols/schema/layouts.py `EncodeError` with the field, the value and the allowed
    range if they cannot be sent. Transactions raise DeviceRejectedError and NoReplyError.
    """

    name: str
    states: Mapping[str, str] = NO_STATES
    """Message → the device's state after sending it ("Config"); empty without states."""
    begins: Collection[str] = ()
    """Messages that signal a restart of the device: work that a command left unfinished is discarded."""
    ends_rest: str = ""
    """The command that ends the state in which settings are read (`AT_REST`); "" without such a state."""
    restart_words: str = "The device restarts so that this takes effect; it sends nothing for about two seconds."
    """What `store_and_restart` does, for the question before it."""
    usual_rates: Sequence[int] = ()
    """Rates that its devices may have been set to, likeliest first, Bd."""

    @abstractmethod
    def commands(self, known: DeviceContext) -> Sequence[Command]:
        """Every command of the document for this product; for all products if it is unknown."""

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        """Readable settings of this device, and whether they are writable."""
        return ()

    def lacking_rules(self, known: DeviceContext) -> str:
        """Sentence on a product for which the tables have no rules; "" for others."""
        return ""

    @abstractmethod
    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        """The bytes of a command (or of an NMEA line)."""

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        """The bytes to write these values (only those given, if the setting is `partial`).

        Args:
            held: as in `write`.
            old: values on the device, as far as known: it may have what the tables do not.
        """
        raise EncodeError(f"{self.name} has no settings")

    def command_frames(self, command: str, values: Values, known: DeviceContext) -> list[bytes]:
        """All frames that `run` sends, in order."""
        return [self.frame(command, values, known)]

    @abstractmethod
    def annotate(self, frame: bytes) -> list[ByteRange]:
        """The frame byte by byte: ordered spans that cover it without overlap."""

    @abstractmethod
    def name_of(self, frame: bytes) -> str:
        """Its name, for the traffic log."""

    def within(self, body: Transaction[T], known: DeviceContext) -> Transaction[T]:
        """`body` in its required state, and the previous one afterwards, also after failure (GoToConfig …
        GoToMeasurement); a device at rest stays at rest.
        """
        return body

    @abstractmethod
    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Send one command and wait for its answer; returns its values."""

    def unfinished(self, command: str, values: Values) -> str | None:
        """Unfinished work of a command that a change of state discards, in words; "" if it completes that of an earlier
        command of its kind; None if neither.
        """
        return None

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        """Settings that a command may change, besides the one it writes (Setting.write).

        Args:
            values: its arguments; missing ones are unknown.
        """
        return ()

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        """The values of one setting."""
        yield from ()  # a transaction is a generator, even one that does nothing
        raise EncodeError(f"{self.name} has no settings")

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        """Write and read back; a refusal is in the result, silence is raised.

        Args:
            held: the values were read from the device, so they are written whatever the tables allow: restoring must
                not depend on our ranges. Only a value that does not fit its field is then an EncodeError.
        """
        yield from ()
        raise EncodeError(f"{self.name} has no settings")

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        """Query the identity: product, serial number, firmware."""
        yield from ()
        return known

    def formerly(self, serial_number: str) -> Sequence[str]:
        """Other numbers that earlier versions of this program used for the same device."""
        return ()

    def line_change(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
        """Effect of this write on the link."""
        return None

    def own_ports(self, values: Mapping[str, Values], known: DeviceContext) -> Sequence[str]:
        """Settings of the port that the link uses ("PortConfig.words.0"); several: it may be any of them."""
        return ()

    def rates(self, values: Mapping[str, Values], known: DeviceContext) -> Sequence[int]:
        """Possible rates of a device with these settings after a restart, likeliest first; empty if the rate does not
        change.
        """
        return ()

    def instead(
        self, command: str, values: Values, present: Mapping[str, Values], known: DeviceContext
    ) -> tuple[str, Values] | None:
        """The setting and the values that replace a command which is deprecated for this product; no values if
        `present` is insufficient. None for a command that is sent unchanged.
        """
        return None

    def risks(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> list[Risk]:
        """Risk of this write, by single fields, apart from `line_change` and the setting's own caution."""
        return []

    def restart_frames(self, values: Mapping[str, Values], known: DeviceContext) -> list[bytes]:
        """All frames of `store_and_restart` and `resume`, if the device has these settings: nothing else is stored."""
        return []

    def store_and_restart(self, known: DeviceContext) -> Transaction[Sequence[bytes]]:
        """Make written values persistent and effective: save them if the protocol requires it, reset. The link may die.

        Returns:
            Frames for `resume`: they start again what runs now and is not stored.
        """
        yield from ()
        return ()

    def resume(self, frames: Sequence[bytes], known: DeviceContext) -> Transaction[None]:
        """Start again what ran before a restart, and store nothing; the device answers."""
        for frame in frames:
            yield Send(frame)

    def takes_writes(self, known: DeviceContext) -> Transaction[bool]:
        """Whether a device that did not answer to one request is still in the state in which it is written."""
        return (yield from self.is_alive(known))

    def confirms(self, frame: bytes, event: Event) -> bool:
        """Whether an event shows that the device has carried out a frame that puts it back (PutBack)."""
        return isinstance(event, Batch | Reply)

    @abstractmethod
    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        """Whether the device answers at the link's present baud rate. Short; never raises."""

    def restore_communication(self, known: DeviceContext) -> Transaction[bool]:
        """The document's procedure for a device that answers at no rate; the user power-cycles it during the
        procedure. Without one, all usual rates are tried.
        """
        for baud in dict.fromkeys((known.baud or self.usual_rates[0], *self.usual_rates)):
            if (yield ReopenLink(baud)) and (yield from self.is_alive(known)):
                return True
        return False

    def load(self, settings: Mapping[str, Values], known: DeviceContext) -> LinkLoad:
        """Load of these settings, bytes per second, exact to the byte."""
        return LinkLoad((), 0.0)

    def message_rate(self, settings: Mapping[str, Values], known: DeviceContext) -> float | None:
        """Messages per second of the kind of message that these settings send most often; None if unknown."""
        return None

    def fit_rates(self, settings: Mapping[str, Values], capacity: float, known: DeviceContext) -> Mapping[str, Values]:
        """The same settings with rates lowered so that their load is within `capacity` bytes per second."""
        return settings

    def factory(self, known: DeviceContext) -> Mapping[str, Values]:
        """The documented factory defaults, of the settings that have one."""
        return {}

    def same(self, setting: str, a: Values, b: Values) -> list[str]:
        """Paths of the fields whose meaning differs between two values of a setting."""
        return [name for name in a if name in b and a[name] != b[name]]
