"""Header messages of an Xsens log: its Configuration, and its stored calibration if available.

    FA FF 0D …      Configuration: device id, outputs; without it the vendor's program does not open a log
    FA FF 91 …      EmtsData: the calibration, encrypted; newer devices only

Both are requested in the config state, so a measuring device pauses (DeviceDriver.within).

Source: MT0101P 2020.A, 5.3.5; that a log begins with both is known from files of the vendor's program.
"""

from __future__ import annotations

from contextlib import suppress

from imuscope.protocols.commands.transactions import DeviceRejectedError, NoReplyError, Transaction
from imuscope.protocols.xbus import frames, requests

REQ_CONFIGURATION, CONFIGURATION = 0x0C, 0x0D
REQ_EMTS, EMTS_DATA = 0x90, 0x91
_TIMEOUT_S = 1.0


def head() -> Transaction[None]:
    """Request both.

    Raises:
        DeviceRejectedError, NoReplyError: no Configuration received.
    """
    yield from requests.send_request(frames.build(REQ_CONFIGURATION), "ReqConfiguration", _TIMEOUT_S)
    with suppress(DeviceRejectedError, NoReplyError):  # most devices do not have it
        yield from requests.send_request(frames.build(REQ_EMTS), "ReqEmts", _TIMEOUT_S, 1)
