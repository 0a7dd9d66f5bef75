"""Detection of a live link whose bytes no longer decode, because the device changed its rate or protocol.

A wrong rate is not silence: bytes still arrive, but without frames. Some are rejected, most never look like a frame. So
the criterion is missing frames: for `UNDECODABLE_S` no frame, sentence or answer, in at least `MIN_BYTES`.
"""

from collections.abc import Sequence

from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.links.base import Link, LinkError

UNDECODABLE_S = 2.0
MIN_BYTES = 100  # fewer may be one long frame that is still incomplete


class DecodeWatchdog:
    """Detector of bytes that no longer decode, for one link."""

    def __init__(self) -> None:
        self._frames = -1  # frames so far
        self._since = 0.0  # when there was one last
        self._bytes = 0  # so far, then
        self._reported = False  # since then

    def update(self, now: float, figures: Sequence[LinkStatistics], configuring: bool) -> bool:
        """Whether the link has become undecodable, once until it decodes again. Call it a few times a second.

        Args:
            figures: of each device of the link; while one of them decodes, the link is decodable.
            configuring: a device is being configured.
        """
        frames = sum(meter.total for one in figures for meter in one.messages.values())
        received_bytes = figures[0].bytes.total  # the link's
        if frames != self._frames or configuring:
            self._frames, self._since, self._bytes, self._reported = frames, now, received_bytes, False
            return False
        if self._reported or now - self._since <= UNDECODABLE_S or received_bytes - self._bytes <= MIN_BYTES:
            return False
        self._reported = True
        return True


def undecodable_text(link: Link) -> tuple[str, str]:
    """Message and hint for undecodable bytes; a link that detects its rate starts a new scan."""
    text = f"Bytes arrive from {link.source}, but none could be decoded for {UNDECODABLE_S:g} s."
    if link.detects_baud:
        hint = "Its baud rate may have changed; it is detected again."
        link.fail(LinkError("gone", text, hint))
    elif link.baud is not None:
        hint = f"If its rate changed from {link.baud} Bd, open it at the new rate, or without a rate to detect it."
    else:
        hint = "Check the baud rate between the device and its adapter, and the protocol."
    return text, hint
