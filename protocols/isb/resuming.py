"""Start what runs on a device again after a restart, without storing it.

    before   streams and sentences of this port, as found
    restart  SAVE_FLASH, SOFTWARE_RESET: the device comes back with the streams that are stored
    after    GET_DATA with its period for each stream found, the sentences; STOP for stored streams that did not run

SAVE_PERSISTENT_MESSAGES would store streams without a request: it is a command of its own, and an option of the
streams.

Source: ISB document, "Persistent Messages", "Get Data Command".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from imuscope.protocols.commands.transactions import DeviceRejectedError, NoReplyError, PutBack, Send, Transaction
from imuscope.protocols.events import Batch, Event, Reply, Text
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.commands import NMEA_PERIODS, RMC, SAVE_FLASH, SOFTWARE_RESET
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.encoder import GPX_RMC, set_frames, streams_frames
from imuscope.protocols.isb.frames import ACK, GET_DATA, NACK, TYPE_MASK
from imuscope.protocols.isb.messages import COMMANDS, ROWS
from imuscope.protocols.isb.stored_settings import STREAMS_SETTING
from imuscope.protocols.isb.stream_discovery import Requester
from imuscope.protocols.isb.streams import dids_of

RESTART = (SAVE_FLASH, SOFTWARE_RESET)
SENTENCES = SETS[NMEA_PERIODS].name
WORDS = (
    "The device saves this configuration and restarts so that it takes effect; it sends nothing for about two seconds. "
    "The streams of this port are then started again; they are not stored. On its other ports only stored streams "
    "run again."
)


def frames_of(values: Mapping[str, Mapping[str, Any]], version: str) -> list[bytes]:
    """The frames that start these streams and sentences on this port."""
    streams = values.get(STREAMS_SETTING, {}).get("streams", [])
    sentences = values.get(SENTENCES, {}).get("nmeaBroadcastMsgs", [])
    packets = streams_frames({"streams": streams})
    if any(one["msgID"] and one["msgPeriod"] for one in sentences):
        values_sent = {"options": 0, "nmeaBroadcastMsgs": sentences}
        packets += set_frames(NMEA_PERIODS, values_sent, version, held=True)
    return packets


def resume(packets: Sequence[bytes], request: Requester, *, gpx: bool) -> Transaction[None]:
    """Start what ran, end stored streams that did not run."""
    for packet in packets:
        yield Send(packet)
    running = {_did(packet) for packet in packets if packet[2] & TYPE_MASK == GET_DATA}
    with suppress(DeviceRejectedError, NoReplyError):
        rmc = yield from request(GPX_RMC if gpx else RMC)
        for did in dids_of(rmc.get("bits", 0), gpx=gpx):
            if did not in running:
                yield Send(frames.build(frames.STOP_DID, did))
    yield PutBack()


def confirms(packet: bytes, event: Event) -> bool:
    """Whether a stream that was requested has come, or is refused; or a sentence, which nothing else starts."""
    if packet[2] & TYPE_MASK != GET_DATA:
        return isinstance(event, Text) or (isinstance(event, Reply) and event.message is COMMANDS[ACK])
    did = _did(packet)
    if isinstance(event, Reply) and event.message is COMMANDS[NACK]:
        return bool(event.values.get("body.dataHdr.id") == did)
    return isinstance(event, Batch | Reply) and event.message is ROWS.get(did)


def _did(packet: bytes) -> int:
    """The data set that a packet requests."""
    return int.from_bytes(packet[6:8], "little")
