"""Channels: quantities of devices, and their columns."""

from dataclasses import dataclass, field
from typing import Literal

Dtype = Literal["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]
Severity = Literal["", "warning", "error"]


@dataclass(slots=True)
class BitsInfo:
    """One flag (width 1) or bit group of a status column; drawn as a lane."""

    name: str
    low: int
    width: int
    choices: dict[str, str] = field(default_factory=dict)  # value (decimal, as JSON keys are strings) → meaning
    severity: Severity = ""
    normal_set: bool = False
    doc: str = ""


@dataclass(slots=True)
class ColumnInfo:
    """One column of a channel, after `arrival` and `time`."""

    name: str  # unique in the channel: "x", "yaw", "itow", "q0"
    dtype: Dtype
    unit: str = ""
    sent_unit: str = ""  # in which the device sends it, if it is shown in another
    label: str = ""  # short label on the plot; "" means name
    axis: Literal["", "x", "y", "z", "w"] = ""  # determines its colour
    choices: dict[str, str] = field(default_factory=dict)
    bits: list[BitsInfo] = field(default_factory=list)
    decimals: int = -1  # digits after the decimal point; -1: chosen by the page
    period: float = 0.0  # wraps at this value; 0: never
    doc: str = ""


@dataclass(slots=True)
class ChannelInfo:
    """One quantity of one device."""

    id: int
    device: str  # DeviceInfo.id
    message: str  # message name in the protocol document: "MTData2"
    name: str  # quantity name in the protocol document: "Acceleration"
    title: str  # displayed: "Acceleration"; if a device sends several with one title, `group` distinguishes them
    kind: Literal["vector", "quaternion", "matrix", "euler", "status", "scalar", "record", "table", "counter"]
    unit: str
    frame: str  # "ENU", "NED", "NWU", "ECEF", "ENU from body" or ""
    columns: list[ColumnInfo]
    doc: str = ""
    source: str = ""
    verified: bool = True  # false: its samples are shown although their sender could not be verified
    group: str = ""  # displayed name of its message: "INS 1"; "" if the title is sufficient
