"""Protection of received frames, in words for the page.

Lite, CRC-8 of the header alone · Safety, CRC-32 · Secure, verified · Secure, unverified: no key
"""

from __future__ import annotations

from imuscope.protocols.events import Batch
from imuscope.protocols.idtp.frames import LITE, SECURE
from imuscope.protocols.idtp.messages import MODE_NAMES, status_name

_CHECKS = {LITE: "CRC-8 of the header alone"}


def protection(batch: Batch) -> str:
    """Protection of the frames of a batch, by the last of them; "" if unknown (an opaque payload)."""
    if not batch.verified:
        return f"{MODE_NAMES[SECURE]}, unverified: no key"
    status = batch.columns.get(status_name(batch.message.name))
    if status is None or not len(status):
        return ""
    mode = int(status[-1]) & 3
    return f"{MODE_NAMES.get(mode, '')}, {_CHECKS.get(mode, 'verified' if mode == SECURE else 'CRC-32')}"
