"""What should a person know about how a stream is read, and what can be done about it?

Three things make a stream look broken that is not, and each is told once, with its remedy:

    frames are refused for a reason that a setting would change (no key, the wrong key, a weaker mode)
    two protocols are mixed in it, of which one is read
    it is read as a protocol that it is not

Beside the event there is a standing notice on the device, and while nothing of it can be shown, its message and hint.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from server.live.incidents import Incidents
from server.wire import Level

LOOK_S = 5.0
RECENT_BYTES, RECENT_CHUNKS = 4096, 64
FEW = 3  # messages of another protocol in that; fewer may be chance

REMEDIES: Mapping[str, tuple[str, str]] = {
    "no_key": (
        "Secure frames are arriving, but there is no key to check them: they are rejected.",
        "Give the key: --key HEX or --key @FILE, or with the source.",
    ),
    "bad_hmac": ("Secure frames come that the key does not fit: they are rejected.", "Is it this device's key?"),
    "below_min_mode": (
        "Frames come in a weaker mode than this source accepts: they are rejected.",
        "Set the device to a stronger mode, or lower --min-mode if you trust the line.",
    ),
}
UNLESS_LIVE = ("bad_hmac",)  # beside frames that fit, one that does not is damaged or forged, and counted


class Advice:
    """What is told about one device.

    Args:
        messages_in: how many messages of each protocol are in some bytes.
        title: a protocol's name for a person.
    Attributes:
        notices: standing remarks, each a sentence or two.
        message, hint: what to say while nothing can be shown; "" for nothing.
    """

    def __init__(
        self,
        incidents: Incidents,
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
                return True
        return False

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
