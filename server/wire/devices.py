"""Devices: state of the device and its link, figures twice a second, payloads that cannot be decoded."""

from dataclasses import dataclass, field
from typing import Literal

DeviceStatus = Literal["connecting", "live", "lost", "denied", "idle", "ended"]
RequiredAction = Literal["", "key", "rearm"]


@dataclass(slots=True)
class Attempt:
    """One attempt to connect to a device, as text."""

    what: str  # "921 600 Bd"
    outcome: str  # "2 304 B, no frame in them"
    time: float


@dataclass(slots=True)
class DeviceInfo:
    """A device and the link it is on."""

    id: str  # of its source, in later runs too: "1"; of a further device on the link of "1": "1.102"
    name: str  # displayed name of the product: "MTi-630"
    source: str  # as given: "/dev/ttyUSB0", "sim:xbus"
    link: str  # a name of LinkCapability: "serial", "tcp", "file"
    status: DeviceStatus
    protocol: str = ""  # "xbus", "" while unknown
    product: str = ""  # "MTi-630 AHRS"
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""  # of its frames, if the protocol has several: "Safety, CRC-32", "Secure, unverified: no key"
    baud: int | None = None
    message: str = ""  # one sentence about the state: "/dev/ttyUSB0 is gone."
    hint: str = ""  # next step for the user
    attempts: list[Attempt] = field(default_factory=list)
    next_attempt: float | None = None  # unix seconds of the next attempt
    last_arrival: float | None = None
    notices: list[str] = field(default_factory=list)  # permanent notices: a high USB latency timer and its fix
    rearm: list[str] = field(default_factory=list)  # senders whose sequence restarted: an operator may re-arm them
    required_action: RequiredAction = ""  # what the user has to do, while no data can be shown
    decode_options: dict[str, str] = field(default_factory=dict)  # given ones by name, without secrets and files
    parent: str = ""  # first device on the same link, if there are several; link, retry and removal belong to it
    is_open: bool = False  # state of its link: a silent device on an open link may still answer
    absent: list[str] = field(default_factory=list)  # flags of its status words that this product does not have
    key: str = ""  # names the sensor on any port and in later runs: "xbus-0080800006"; its source if it sent no number
    own_name: str = ""  # given by users, stored with the key; "" if none
    resume: str = ""  # command that makes a device send again that is quiet for a known reason: "GoToMeasurement"
    topic: str = ""  # name under which others subscribe to it, in later runs too: "imu", "imu_2"; "" of a file
    former_name: str = ""  # displayed name when it was identified last, before this run; "" if it never was
    quiet_since: float | None = None  # unix s at which it became quiet for a known reason, which `message` gives
    simulated: bool = False  # a simulator made its data, also those of a recording that is played
    unconfirmed_since: float | None = None  # unix seconds at which its link came back: another sensor may be there

    @property
    def lasting_name(self) -> str:
        """Its name, see the function."""
        return lasting_name(self.name, self.product, self.former_name)


@dataclass(slots=True)
class MessageHealth:
    """Figures of one message of one device."""

    name: str
    rate: float  # samples/s over the last second
    count: int  # since the session began


@dataclass(slots=True)
class JitterCause:
    """Cause of uneven arrival times, and its remedy."""

    kind: Literal["bursts", "resets", "stalls", "network"]
    text: str  # one sentence or two
    remedy: str


BusyReason = Literal["", "others", "decoding"]
"""Why decoding is behind, as far as it is counted: it had to wait for a processor, or took all the time of one."""


@dataclass(slots=True)
class Behind:
    """Time by which the newest samples of a device are late, s, by where that arises; 0 while all keeps up."""

    link: float = 0.0  # until its bytes arrive here, by the device's clock, over its fastest ones
    decoding: float = 0.0  # of the oldest bytes that have arrived and are not decoded
    reason: BusyReason = ""  # why decoding is behind, if it is and that is known


@dataclass(slots=True)
class DeviceHealth:
    """Figures of one device; rates over the last second, counts since the session began. Rejected, verified and
    unverified frames are counted since the decode options were set: a new key restarts these counts.
    """

    device: str
    time: float
    rate: float  # samples/s of the fastest message
    messages: list[MessageHealth]
    gaps: int
    lost: int  # missing samples, according to counters
    rejects: int
    bytes: int
    bytes_per_s: float
    capacity: float | None  # bytes/s the link can carry, if known
    jitter_ms: float | None  # p99 of arrival minus expected arrival over the last seconds
    last_arrival: float | None
    drift_ppm: float | None  # device clock against host clock; null while it is unknown
    uncertainty_ms: float | None  # ± of the mapping from device time to host time; null while it is unknown
    rejects_by: dict[str, int] = field(default_factory=dict)  # reason → how many of `rejects`: "bad_checksum", "no_key"
    unclaimed: int = 0  # bytes that belong to no accepted frame and no known message; those of rejected frames count
    verified: int | None = None  # samples whose frames passed all checks; null if the protocol has no such check
    unverified: int | None = None  # samples shown although their frames could not be checked
    dropped: int = 0  # samples dropped for this browser
    behind: Behind = field(default_factory=Behind)  # measured here; a page adds its own part
    jitter_cause: JitterCause | None = None  # cause of uneven arrival times; null while they are even
    drift_bound_ppm: float | None = None  # ± of `drift_ppm`
    time_presumes: str = ""  # condition under which both ± hold, or why they are unknown
    numbered: int = 0  # samples received that counters number; lost ones are a share of both together


@dataclass(slots=True)
class UnknownPayload:
    """Newest payload of a type without a description: a vendor-specific type, or one newer than the tables."""

    device: str
    name: str  # "0x80", "0x4FF0", "DID_RTK_DEBUG_2"
    id: int  # type number in the protocol
    message: str  # displayed name of its message
    count: int  # since the session began
    rate: float  # per second
    size: int  # bytes of the payload
    hex: str  # at most its first 1024 bytes
    arrival: float  # of this one, unix seconds
    doc: str = ""
    verified: bool = True


def lasting_name(name: str, product: str = "", former_name: str = "") -> str:
    """The displayed name of a device, or that of earlier runs while it is not identified in this one."""
    return name if product else former_name or name


def key_of(device: DeviceInfo) -> str:
    """The key of a device: "xbus-0080800006"; its source (and its name on the link) while it has sent no number."""
    if device.serial_number:
        return f"{device.protocol}-{device.serial_number}"
    _, point, member = device.id.partition(".")
    return f"{device.source}{point}{member}"
