"""Command exchanges without I/O: how is a device asked, and what is done when it does not answer?

A dialogue is a generator. It yields what it wants done and is sent what came of it; it never sleeps, reads or writes by
itself, so a test plays it with a list and the server plays it on a link:

    def ask(frame):                          the runner
        yield Send(frame, "ReqDID")          writes the bytes, sends None
        values = yield WaitFor(did, 0.5)      feeds every event to `did` until it makes something of one, sends that;
                                             sends None when the time is up
        return values                        has the result of the dialogue

    yield Sleep(0.1)                         waits, sends None
    yield ReopenLink(baud=921600)                closes the link and opens it at that rate, sends True; False: it cannot
    yield Note("It is restarted.")           tells who watches what no frame shows, sends None

What a device refuses is a `DeviceRejectedError`, what it never answers a `NoReplyError`; both say what was asked, so
that the page can show it. A runner that is stopped calls `cancel(dialogue)` and writes the frames that it returns
(GoToMeasurement after a browser has gone). Not `close()`: a generator that is being closed may not yield any more.

A body that is given to `DeviceDriver.within` runs in the state in which settings are read and written, unless it says
otherwise (`RequiresState`): some commands make sense only while the device measures.

`DeviceDriver` is what a protocol knows about configuring its devices; protocols/registry.py has one for each.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar

from protocols.events import Event
from protocols.schema import Caution, Command, Setting

T = TypeVar("T")
NO_STATES: Mapping[str, str] = {}
AT_REST = "Config"  # of `DeviceDriver.states`: a device stays in it when a person has sent it there
Values = Mapping[str, Any]
"""Wire values by field name, as `imuscope inspect` prints them: integers for choices and flag words, lists, records as
objects, bytes as hex."""


@dataclass(frozen=True, slots=True)
class Send:
    """Write these bytes. `what` names them where the protocol's own listing cannot."""

    frame: bytes
    what: str = ""


@dataclass(frozen=True, slots=True)
class WaitFor:
    """Wait for an event of which `match` makes something; None after `timeout_s`."""

    match: Callable[[Event], Any | None]
    timeout_s: float
    what: str = ""


@dataclass(frozen=True, slots=True)
class Sleep:
    """Wait, seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class ReopenLink:
    """Close the link and open it again, at another rate where one is given; what arrives afterwards is decoded anew."""

    baud: int | None = None


@dataclass(frozen=True, slots=True)
class Note:
    """Tell whoever watches: a sentence that the frames do not say by themselves (a device is restarted, and why)."""

    words: str


Act = Send | WaitFor | Sleep | ReopenLink | Note
Transaction = Generator[Act, Any, T]


class DeviceRejectedError(Exception):
    """The device said no: `what` was asked and why, in the document's words ("parameter invalid or outside range")."""

    def __init__(self, what: str, why: str, code: int | None = None) -> None:
        super().__init__(f"{what}: {why}")
        self.what, self.why, self.code = what, why, code


class NoReplyError(Exception):
    """No answer to `what` after `tries` tries of `timeout_s` each."""

    def __init__(self, what: str, tries: int, timeout_s: float) -> None:
        super().__init__(f"No answer to {what} ({tries} tries of {timeout_s:g} s).")
        self.what, self.tries, self.timeout_s = what, tries, timeout_s


class TransactionCancelledError(Exception):
    """Thrown into a dialogue that is stopped: it may still yield `Send` for what must not be left undone."""


def cancel(dialogue: Transaction[Any]) -> list[Send]:
    """End a dialogue before its time.

    Returns:
        What the runner still has to write, in order; waits and expectations are skipped.
    """
    last: list[Send] = []
    try:
        act = dialogue.throw(TransactionCancelledError())
        while True:
            if isinstance(act, Send):
                last.append(act)
            act = dialogue.send(None)
    except (StopIteration, TransactionCancelledError, DeviceRejectedError, NoReplyError):
        return last


class RequiresState(Generator[Act, Any, T]):
    """A dialogue that says in which state the device must be: "config", "measuring", or "any".

    `DeviceDriver.within` looks at it; for anything else it is the dialogue itself.

    Args:
        continues: it takes up what an earlier command began (stores a reset, ends a calibration): between the two the
            device must neither restart nor pass through another state.
    """

    def __init__(
        self, dialogue: Transaction[T], state: Literal["config", "measuring", "any"], *, continues: bool = False
    ) -> None:
        self._dialogue = dialogue
        self.state = state
        self.continues = continues

    def send(self, value: Any, /) -> Act:
        return self._dialogue.send(value)

    def throw(self, *args: Any) -> Act:
        return self._dialogue.throw(*args)


@dataclass(frozen=True, slots=True)
class DeviceContext:
    """What is known about a device; empty where it has not told.

    Args:
        baud: of the link now; None where it has none.
        device: who is meant where a link carries several (an IDTP device id, the bus identifier of an MTi).
        key: for Secure frames; None without.
        at_rest: a person has sent it to the state in which settings are read, and there it stays
        (`DeviceDriver.within`).
    """

    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    baud: int | None = None
    device: str = ""
    key: bytes | None = field(default=None, repr=False)
    at_rest: bool = False


@dataclass(frozen=True, slots=True)
class ByteRange:
    """A few bytes of a frame and what they mean: `path` names the field ("outputs.3"), "" for the envelope's own."""

    offset: int
    size: int
    label: str
    path: str = ""


@dataclass(frozen=True, slots=True)
class OutputLoad:
    """What one output costs: `path` names it in the setting ("outputs.3")."""

    path: str
    title: str
    bytes_per_s: float


@dataclass(frozen=True, slots=True)
class LinkLoad:
    """Bytes per second that outputs ask of the line.

    Args:
        parts: one per output; what every message costs whatever is in it (header, checksum) is the part with path "".
        total: sum of the parts.
        limits: per-message limits that are broken, one sentence each.
    """

    parts: tuple[OutputLoad, ...]
    total: float
    limits: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class WriteResult:
    """What came of writing one setting.

    Args:
        asked: the values sent.
        got: the values read back; None where they could not be read.
        refused: why nothing was written, in the document's words; "" when it was.
    """

    setting: str
    asked: Values
    got: Values | None = None
    refused: str = ""


@dataclass(frozen=True, slots=True)
class BaudChange:
    """A change after which the line may be dead.

    Args:
        baud: rate of the line afterwards; None where it is not the rate that changes.
        kind: "baud" (the rate), "port" (it may be off), "protocol" (another language), "silent" (no output).
        words: one sentence for a person.
        others: rates at which the device may be found as well, where it is not known which port is ours.
    """

    kind: Literal["baud", "port", "protocol", "silent"]
    words: str
    baud: int | None = None
    others: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Harm:
    """What something could cost: its kind, and one sentence for a person."""

    caution: Caution
    consequence: str


class DeviceDriver(Protocol):
    """What a protocol knows about configuring its devices. Tables, frames and dialogues; no I/O, no state.

    Every method that takes values raises protocols.layouts.EncodeError with the field's path, the value and the allowed
    range when they cannot be sent. Dialogues raise DeviceRejectedError and NoReplyError.
    """

    name: str
    states: Mapping[str, str]
    """Message → the state that a device is in when it has sent it ("Config"); empty where there are no states."""
    begins: Collection[str]
    """Messages with which a device begins anew: what a command left unfinished is discarded."""
    ends_rest: str
    """The command that ends the state in which settings are read (`AT_REST`); "" where there is no such state."""

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        """Every command of the document that this product has; all of the protocol while it is not known."""

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        """Everything this device keeps that can be read, and what of it can be written."""

    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        """The bytes of a command (an NMEA line, too, is bytes)."""

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        """The bytes that would write these values (only those given, where the setting is `partial`).

        Args:
            held: as of `write`.
            old: what the device has, where that is known and decides what has to be sent.
        """

    def spans(self, frame: bytes) -> list[ByteRange]:
        """The frame byte by byte: spans that cover it without overlap, in order."""

    def name_of(self, frame: bytes) -> str:
        """Its name, for the log of the exchange."""

    def within(self, body: Transaction[T], known: DeviceContext) -> Transaction[T]:
        """`body` in the state that it needs, and back afterwards, also after failure (GoToConfig … GoToMeasurement);
        a device that was at rest stays at rest."""

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Send one command, wait for what answers; its values."""

    def unfinished(self, command: str, values: Values) -> str | None:
        """What a command leaves open that a change of state throws away, in words; "" where it ends that of an earlier
        command of its kind; None where it does neither."""

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        """Settings that may be others after a command, beside those that it is there to write (Setting.write).

        Args:
            values: its arguments; one that is not in it is not known.
        """

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        """The values of one setting."""

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        """Write and read back; a refusal is in the result, silence is raised.

        Args:
            held: the device has told these values itself, so they go back whatever the tables allow: a way back must
                not depend on our ranges. Only what does not fit the bytes of its field is an EncodeError then.
        """

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        """Ask who it is: product, serial number, firmware."""

    def formerly(self, serial_number: str) -> Sequence[str]:
        """Other numbers under which earlier versions of this program filed the same device."""

    def line_change(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
        """Would this write cut the line?"""

    def rates(self, values: Mapping[str, Values], known: DeviceContext) -> Sequence[int]:
        """Rates at which a device with these settings may be found after a restart, likeliest first; empty where it
        stays where it is."""

    def instead(
        self, command: str, values: Values, present: Mapping[str, Values], known: DeviceContext
    ) -> tuple[str, Values] | None:
        """The setting and the values that have the place of a command which this product should not be sent any more;
        no values where `present` does not tell enough. None for a command that is sent as it is."""

    def harm(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> list[Harm]:
        """What this write could cost beside what `line_change` and the setting's own caution say: of single fields."""

    def store_and_restart(self, known: DeviceContext) -> Transaction[None]:
        """Make what was written last and take effect: save where the protocol asks for it, reset. The link may die."""

    def alive(self, known: DeviceContext) -> Transaction[bool]:
        """Is the device there and does it speak, at the link's present rate? Short; never raises."""

    def restore_communication(self, known: DeviceContext) -> Transaction[bool]:
        """The document's procedure for a device that answers at no rate; a person switches its power meanwhile."""

    def load(self, settings: Mapping[str, Values], known: DeviceContext) -> LinkLoad:
        """What these settings make the device send, bytes per second, exact to the byte."""

    def fit(self, settings: Mapping[str, Values], capacity: float, known: DeviceContext) -> Mapping[str, Values]:
        """The same settings with rates lowered so that their load is within `capacity` bytes per second."""

    def factory(self, known: DeviceContext) -> Mapping[str, Values]:
        """The documented factory defaults, of those settings where the document tells them."""

    def same(self, setting: str, a: Values, b: Values) -> list[str]:
        """Paths of the fields in which two values of a setting differ in what they mean."""
