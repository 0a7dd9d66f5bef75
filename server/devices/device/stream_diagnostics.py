"""Warnings about how a stream is decoded, with remedies.

Some conditions make an intact stream look broken. Each is reported once, with its remedy:

    frames are rejected for a reason that an option would change (no key, the wrong key, a weaker mode)
    two protocols are mixed in the stream, and only one is decoded
    the stream is decoded as the wrong protocol
    a Secure device restarted and waits for re-arming
    its timestamps have another unit than assumed
    its frames arrive over a network with unprotected payloads

Besides the event, the device has a permanent notice, and a message and hint while none of its data can be shown.
"""

import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from imuscope.protocols.events import Doubt
from imuscope.protocols.registry.families import PROTOCOLS, remedies
from imuscope.server.devices.device.event_reporter import EventReporter
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.links.base import Chunk
from imuscope.server.links.registry import is_network
from imuscope.server.wire import DeviceInfo, Level, RequiredAction

CHECK_INTERVAL_S = 5.0
RECENT_BYTES, RECENT_CHUNKS = 4096, 64
REARM = (
    "If it was restarted, re-arm it, here or with `imuscope rearm`. If not, this may be a replay of captured frames."
)
MIN_MESSAGES = 3  # messages of another protocol in these bytes; fewer may be chance

REFUSALS: Mapping[str, tuple[str, str]] = {
    "stale": (
        "Frames arrive with old sequence numbers and are rejected.",
        "A restarted device is accepted again 3 s after its last accepted frame; no action is needed.",
    ),
    "far_ahead": (
        "Frames arrive with sequence numbers far ahead and are rejected.",
        "They are accepted once two of them agree.",
    ),
}
"""Reasons of rejects that no option would change; families can add their own."""


def _refusals() -> Mapping[str, tuple[str, str]]:
    own = (reason for family in PROTOCOLS.values() for reason in family.decoding.refusals.items())
    return {**REFUSALS, **dict(own)}


def _unprotected(protocol: str) -> tuple[str, str]:
    family = PROTOCOLS.get(protocol)
    return family.decoding.unprotected if family is not None else ("", "")


def doubt_text(option: str, doubt: Doubt) -> str:
    """Report of an option whose value follows from the stream instead of from the user."""
    words = f"{doubt.subject.capitalize()} are read with {option}={doubt.value}: {doubt.reason}."
    return f"{words} Set {option} to confirm it."


class StreamDiagnostics:
    """Diagnostics of the stream of one device.

    Args:
        count_messages: number of messages of each protocol in some bytes.
        title: displayed name of a protocol.

    Attributes:
        notices: permanent remarks, one or two sentences each.
        message, hint: texts while no data can be shown; "" for none.
        required_action: of the user, before data can be shown.
    """

    def __init__(
        self,
        incidents: EventReporter,
        count_messages: Callable[[bytes], Mapping[str, int]],
        title: Callable[[str], str],
    ) -> None:
        self._events = incidents
        self._count_messages = count_messages
        self._title = title
        self._recent: deque[bytes] = deque(maxlen=RECENT_CHUNKS)
        self._checked_at = 0.0
        self._unclaimed: int | None = 0  # at the last check
        self._reported: set[str] = set()
        self.notices: list[str] = []
        self.message = self.hint = ""
        self.required_action: RequiredAction = ""
        self._restarted: dict[str, str] = {}
        self._refused_before: dict[str, int] = {}

    def on_chunks(self, chunks: Sequence[Chunk]) -> None:
        """Store the last bytes; cheap."""
        for chunk in chunks[-RECENT_CHUNKS:]:
            self._recent.append(chunk.data[-RECENT_BYTES:])

    def refused(self, by_reason: Mapping[str, int], *, live: bool) -> bool:
        """Check the rejects so far; True if there is something new to show."""
        if not by_reason:
            return False
        for reason, one in remedies().items():
            if by_reason.get(reason) and reason not in self._reported and not (live and one.is_damage):
                self._reported.add(reason)
                self._report("warning", f"{one.words} {one.remedy}", {"reason": reason})
                self.message, self.hint = one.words, one.remedy
                self.required_action = one.needed or self.required_action
                return True
        for reason, (words, remedy) in _refusals().items():
            if by_reason.get(reason) and not live and not self.message:
                self.message, self.hint = words, remedy
                return True
        return False

    def refusal(self, figures: LinkStatistics) -> tuple[str, str] | None:
        """Message and hint if every recent frame of a device was rejected and none was damaged; else None."""
        before, self._refused_before = self._refused_before, dict(figures.rejects_by)
        new = {reason: count - before.get(reason, 0) for reason, count in figures.rejects_by.items()}
        reason = max(new, key=lambda one: new[one], default="")
        if self._restarted:
            return self.message, self.hint
        if not new.get(reason):
            return None
        remedy = remedies().get(reason)
        return (remedy.words, remedy.remedy) if remedy is not None else _refusals().get(reason)

    def restarted(self, waiting: Mapping[str, str]) -> bool:
        """Update the Secure devices that wait to be re-armed, with texts; True if there is something new to show."""
        if waiting.keys() == self._restarted.keys():
            return False
        for device, words in waiting.items():
            if device not in self._restarted:
                self._report("error", f"{words} {REARM}", {"reason": "restarted", "device": device})
        for device, words in self._restarted.items():
            if device not in waiting:
                with contextlib.suppress(ValueError):
                    self.notices.remove(f"{words} {REARM}")
        self._restarted = {device: self._restarted.get(device, words) for device, words in waiting.items()}
        self.message, self.hint = (" ".join(waiting.values()), REARM) if waiting else ("", "")
        self.required_action = "rearm" if waiting else ""
        return True

    def exposed(self, kind: str, devices: Sequence[DeviceInfo]) -> bool:
        """Report frames with unprotected payload over a network; True if that is new."""
        if not is_network(kind) or "exposed" in self._reported:
            return False
        families = [(one.protection, *_unprotected(one.protocol)) for one in devices]
        hints = [(mode, hint) for protection, mode, hint in families if mode and protection.startswith(mode)]
        if not hints:
            return False
        [(mode, hint), *_] = hints
        self._reported.add("exposed")
        words = "arrive over a network, where their values are not protected against damage or forgery."
        self._report("warning", f"Frames in {mode} mode {words} {hint}", {"reason": "exposed"})
        return True

    def on_contradiction(self, option: str, doubt: Doubt, *, is_configured: bool) -> bool:
        """Report that arrival times contradict the value of an option; True if that is new."""
        if option in self._reported:
            return False
        self._reported.add(option)
        if is_configured:
            words = f"The {doubt.subject} contradict their arrival: {doubt.reason}. Consider {option}={doubt.value}."
        else:
            words = doubt_text(option, doubt)
        self._report("warning", words, {"reason": "unit", "unit": doubt.value})
        return True

    def update(
        self, now: float, protocol: str, *, samples: int, unclaimed: int | None = None, at_once: bool = False
    ) -> bool:
        """Search the last bytes for other protocols at intervals; True if there is something new to show.

        Args:
            protocol: protocol used for decoding.
            samples: samples decoded since the link was opened.
            unclaimed: bytes so far that belong to no message of this protocol; without new ones there is nothing to
                search. None if that is unknown.
        """
        if "mixed" in self._reported or not self._recent or (now - self._checked_at < CHECK_INTERVAL_S and not at_once):
            return False
        self._checked_at = now
        before, self._unclaimed = self._unclaimed, unclaimed
        if samples and unclaimed is not None and unclaimed == before:
            self._recent.clear()
            return False
        counts = self._count_messages(b"".join(self._recent)[-RECENT_BYTES:])
        self._recent.clear()
        others = [name for name, count in counts.items() if count >= MIN_MESSAGES and name != protocol]
        if not others:
            return False
        self._reported.add("mixed")
        here, names = self._title(protocol), " and ".join(self._title(name) for name in others)
        data = {"protocols": [protocol, *others]}
        if samples or counts.get(protocol, 0) >= MIN_MESSAGES:
            words = f"Two protocols are mixed in this stream, {here} and {names}: it is decoded as {here}."
            self._report("warning", f"{words} Use a separate link for each device.", data)
            return True
        self.message, self.hint = f"These bytes are {names}, but are decoded as {here}.", "Choose another protocol."
        self._report("error", f"{self.message} {self.hint}", data)
        return True

    def _report(self, level: Level, text: str, data: Mapping[str, object]) -> None:
        self.notices.append(text)
        self._events.report("device", level, text, data=dict(data))
