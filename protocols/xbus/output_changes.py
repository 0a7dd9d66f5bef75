"""Interruptions of the output on request, recognised by the device's answers.

    GoToConfigAck                              no samples until GoToMeasurement
    ReqStringOutputTypeAck, types ≠ 0          strings in place of samples
    ReqSyncSettingsAck with SendLatest         a sample for each request, those between are not sent
    WakeUp                                     the device has restarted

Whether a device goes on counting then is not documented, so missing numbers after one of these do not indicate a
damaged line.

Source: MT0101P 2020.A, 5.3.1, 5.3.4 and 5.3.5.
"""

from imuscope.protocols.events import Reply
from imuscope.protocols.xbus.enums import SEND_LATEST

GO_TO_CONFIG_ACK, STRINGS_ACK, SYNC_ACK, WAKE_UP = 0x31, 0x8F, 0x2D, 0x3E

CONFIGURED = "the device was in the config state, in which it does not measure."
STRINGS = "the device was switched to string output, which replaces the samples."
ON_REQUEST = "the device sends a sample on request only (SendLatest); those between were not requested."
RESTARTED = "the device restarted."


class XbusOutputChanges:
    """See family.OutputChanges."""

    def __init__(self) -> None:
        self._on_request = False

    @property
    def standing(self) -> tuple[int, str] | None:
        return (2, ON_REQUEST) if self._on_request else None

    def observe(self, reply: Reply) -> tuple[int, str] | None:
        number = reply.message.id
        if number == WAKE_UP:
            return 2, RESTARTED
        if number == STRINGS_ACK and reply.values.get("string_types"):
            return 3, STRINGS
        if number == SYNC_ACK and "settings" in reply.values:
            entries = reply.values["settings"]
            self._on_request = any(one["function"] == SEND_LATEST and one["polarity"] for one in entries)
        return (1, CONFIGURED) if number == GO_TO_CONFIG_ACK else None
