"""Foreign messages between the frames of a stream: NMEA, UBX, RTCM.

    bytes   $GNGGA,…*hh\\r\\n  B5 62 … CK CK  D3 00 … CRC
    found   nmea              ubx            rtcm3

Binary messages are searched for first, because their payloads may contain anything, even a `$`; sentences in the rest.
If two overlap, the first valid one from the left wins. A false length costs nothing: it delays only the messages found
here, by at most ubx.MAX_PAYLOAD_BYTES, and never a frame of the stream's own protocol, which the scanner finds before
this search.
"""

import re
from dataclasses import replace

from imuscope.protocols.embedded import nmea, rtcm, ubx
from imuscope.protocols.events import ParsedMessage

STARTS = re.compile(nmea.STARTS.pattern + b"|" + re.escape(ubx.SYNC) + b"|" + rtcm.SYNC + b"[\x00-\x03]")
_STARTS = re.compile(b"[" + ubx.SYNC[:1] + rtcm.SYNC + b"]")


def find(data: bytes, *, final: bool) -> tuple[list[ParsedMessage], int]:
    """All foreign messages in `data`, a stretch without frames of the stream's own protocol.

    Args:
        final: no data follows; incomplete messages will never be completed.

    Returns:
        the messages in order, with an empty name if a check failed; and the position from which bytes must be kept
        because a message there may be incomplete (the length of `data` if none is).
    """
    if not _STARTS.search(data):
        return nmea.find_nmea(data, final=final)
    messages: list[ParsedMessage] = []
    text = 0  # where the search for sentences continues
    at = 0
    while start := _STARTS.search(data, at):
        at = start.start()
        module = rtcm if data[at] == rtcm.SYNC[0] else ubx
        one = module.message_at(data, at, final=final)
        if one == ubx.WAIT:
            return messages + _sentences(data, text, at, final=True)[0], at  # no sentence continues over such a byte
        if isinstance(one, ParsedMessage):
            messages += _sentences(data, text, at, final=True)[0]
            messages.append(one)
            text = at = at + one.size
        else:
            at += 1
    sentences, end = _sentences(data, text, len(data), final=final)
    return messages + sentences, end


def _sentences(data: bytes, start: int, stop: int, *, final: bool) -> tuple[list[ParsedMessage], int]:
    if start >= stop:
        return [], stop
    sentences, end = nmea.find_nmea(data[start:stop], final=final)
    return [replace(one, offset=start + one.offset) for one in sentences], start + end
