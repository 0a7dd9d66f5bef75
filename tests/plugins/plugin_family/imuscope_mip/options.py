"""Decode options of MIP: properties that a device does not report."""

from imuscope.plugin import DecodeOption

ARRIVAL = "arrival"
OPTIONS = (
    DecodeOption(
        "timestamps",
        "choice",
        "which time samples have: of the device, or of arrival if its GPS time was never set (default: device)",
        (("device", "Of the device"), (ARRIVAL, "Of arrival")),
        recorded=True,
        title="Timestamps",
        default="device",
    ),
)
