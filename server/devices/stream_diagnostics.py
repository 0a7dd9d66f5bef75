"""What should a person know about how a stream is read, and what can be done about it?

Some things make a stream look broken that is not, and each is told once, with its remedy:

    frames are refused for a reason that a setting would change (no key, the wrong key, a weaker mode)
    two protocols are mixed in it, of which one is read
    it is read as a protocol that it is not
    a Secure device restarted, and waits for an operator
    its timestamps count in another unit than is assumed
    it comes over a network in frames whose payload nothing protects

Beside the event there is a standing notice on the device, and while nothing of it can be shown, its message and hint.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from protocols.events import Doubt
from server.devices.event_reporter import EventReporter
from server.devices.jitter_causes import NETWORKS
from server.devices.link_stats import LinkStatistics
from server.wire import DeviceInfo, Level, Wants

LOOK_S = 5.0
RECENT_BYTES, RECENT_CHUNKS = 4096, 64
REARM = (
    "If you restarted it, re-arm it, here or with `imuscope rearm`. "
    "If nobody did, somebody may be playing captured frames again."
)
FEW = 3  # messages of another protocol in that; fewer may be chance

REMEDIES: Mapping[str, tuple[str, str]] = {
    "no_key": (
        "Secure frames are arriving, but there is no key to check them: they are rejected.",
        "Give the key: --key @FILE, or here.",
    ),
    "bad_hmac": ("Secure frames come that the key does not fit: they are rejected.", "Is it this device's key?"),
    "below_min_mode": (
        "Frames come in a weaker mode than this source accepts: they are rejected.",
        "Set the device to a stronger mode, or lower --min-mode if you trust the line.",
    ),
}
REFUSALS: Mapping[str, tuple[str, str]] = {
    "stale": (
        "Frames come with old sequence numbers, and are refused.",
        "A device that restarted is accepted again 3 s after its last accepted frame; nothing needs to be done.",
    ),
    "far_ahead": (
        "Frames come whose sequence numbers are far ahead, and are refused.",
        "They are accepted once two of them agree.",
    ),
    "bad_version": ("Frames come of a version that is not read here.", "This program reads IDTP 2."),
    "indt": ("These bytes are INDT, the successor of IDTP.", "It is not read here."),
}
"""Why whole frames are refused without a setting that would change it."""

UNPROTECTED = "Lite"  # begins the protection (registry.ProtocolInfo) of such frames
EXPOSED_HINT = "Set the device to Safety, or to Secure with a key, and --min-mode so that weaker ones are refused."
UNLESS_LIVE = ("bad_hmac",)  # beside frames that fit, one that does not is damaged or forged, and counted


class StreamDiagnostics:
    """What is told about one device.

    Args:
        messages_in: how many messages of each protocol are in some bytes.
        title: a protocol's name for a person.
    Attributes:
        notices: standing remarks, each a sentence or two.
        message, hint: what to say while nothing can be shown; "" for nothing.
        wants: what the device waits for meanwhile.
    """

    def __init__(
        self,
        incidents: EventReporter,
        messages_in: Callable[[bytes], Mapping[str, int]],
        title: Callable[[str], str],
    ) -> None:
        self._incidents = incidents
        self._messages_in = messages_in
        self._title = title
        self._recent: deque[bytes] = deque(maxlen=RECENT_CHUNKS)
        self._looked_at = 0.0
        self._told: set[str] = set()
        self.notices: list[str] = []
        self.message = self.hint = ""
        self.wants: Wants = ""
        self._restarted: dict[str, str] = {}
        self._refused_before: dict[str, int] = {}

    def hear(self, data: bytes) -> None:
        """Keep the last bytes; cheap."""
        self._recent.append(data[-RECENT_BYTES:])

    def refused(self, by_reason: Mapping[str, int], *, live: bool) -> bool:
        """Look at what was rejected so far; True when there is something new to show."""
        for reason, (words, remedy) in REMEDIES.items():
            if by_reason.get(reason) and reason not in self._told and not (live and reason in UNLESS_LIVE):
                self._told.add(reason)
                self._tell("caution", f"{words} {remedy}", {"reason": reason})
                self.message, self.hint = words, remedy
                self.wants = "key" if reason == "no_key" else self.wants
                return True
        for reason, (words, remedy) in REFUSALS.items():
            if by_reason.get(reason) and not live and not self.message:
                self.message, self.hint = words, remedy
                return True
        return False

    def refusal(self, figures: LinkStatistics) -> tuple[str, str] | None:
        """Message and hint of a device of which every frame was refused lately, and none was damaged; else None."""
        before, self._refused_before = self._refused_before, dict(figures.rejects_by)
        new = {reason: count - before.get(reason, 0) for reason, count in figures.rejects_by.items()}
        reason = max(new, key=lambda one: new[one], default="")
        if self._restarted:
            return self.message, self.hint
        return {**REMEDIES, **REFUSALS}.get(reason) if new.get(reason) else None

    def restarted(self, waiting: Mapping[str, str]) -> bool:
        """Secure devices that wait to be re-armed → what is said of each; True when there is something new to show."""
        if waiting.keys() == self._restarted.keys():
            return False
        for device, words in waiting.items():
            if device not in self._restarted:
                self._tell("fault", f"{words} {REARM}", {"reason": "restarted", "device": device})
        for device, words in self._restarted.items():
            if device not in waiting:
                with contextlib.suppress(ValueError):
                    self.notices.remove(f"{words} {REARM}")
        self._restarted = dict(waiting)
        self.message, self.hint = (" ".join(waiting.values()), REARM) if waiting else ("", "")
        self.wants = "rearm" if waiting else ""
        return True

    def exposed(self, kind: str, devices: Sequence[DeviceInfo]) -> bool:
        """Frames whose payload nothing protects come over a network; True when that is new."""
        found = [one for one in devices if one.protection.startswith(UNPROTECTED)]
        if not found or kind not in NETWORKS or "exposed" in self._told:
            return False
        self._told.add("exposed")
        words = "come over a network, where nothing protects their values from damage, or from who forges them."
        self._tell("caution", f"Frames in {UNPROTECTED} mode {words} {EXPOSED_HINT}", {"reason": "exposed"})
        return True

    def doubted(self, doubt: Doubt, *, given: bool) -> bool:
        """Arrival contradicts the unit of the timestamps; True when that is new."""
        if "unit" in self._told:
            return False
        self._told.add("unit")
        if given:
            words = f"The timestamps contradict their arrival: {doubt.reason}. Is time_unit={doubt.unit} meant?"
        else:
            words = f"Timestamps are read with time_unit={doubt.unit}: {doubt.reason}. Set time_unit to settle it."
        self._tell("caution", words, {"reason": "unit", "unit": doubt.unit})
        return True

    def look(self, now: float, protocol: str, *, samples: int, at_once: bool = False) -> bool:
        """Now and then, look for other protocols in the last bytes; True when there is something new to show.

        Args:
            protocol: as which the stream is read; samples: that came of it since the link was opened.
        """
        if "mixed" in self._told or not self._recent or (now - self._looked_at < LOOK_S and not at_once):
            return False
        self._looked_at = now
        found = self._messages_in(b"".join(self._recent)[-RECENT_BYTES:])
        self._recent.clear()
        others = [name for name, count in found.items() if count >= FEW and name != protocol]
        if not others:
            return False
        self._told.add("mixed")
        here, names = self._title(protocol), " and ".join(self._title(name) for name in others)
        data = {"protocols": [protocol, *others]}
        if samples or found.get(protocol, 0) >= FEW:
            words = f"Two protocols are mixed in this stream, {here} and {names}: it is read as {here}."
            self._tell("caution", f"{words} Give each device a link of its own.", data)
            return True
        self.message, self.hint = f"These bytes are {names}, and are read as {here}.", "Choose another protocol."
        self._tell("fault", f"{self.message} {self.hint}", data)
        return True

    def _tell(self, level: Level, text: str, data: Mapping[str, object]) -> None:
        self.notices.append(text)
        self._incidents.say("device", level, text, data=dict(data))
