"""A protocol family: everything the rest of the program knows about a protocol and its devices, as one object.

A family is found through the entry-point group `imuscope.protocols` (protocols/family/plugins.py). Only its name and
title, `likeness`, `listing`, `sample` and `scan` of its frames, and its decoder are needed to show, record and replay a
device; the other members are optional features. docs/add-a-protocol-family.md explains how to write one.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.commands.mounting import MountingSetting
from imuscope.protocols.commands.rate_tables import RateTable
from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Transaction, Values
from imuscope.protocols.events import Batch, Decoder, Reply
from imuscope.protocols.family.decode_options import DecodeOption, settings_of
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.framing.stream_buffer import Scan
from imuscope.protocols.schema.fields import Message
from imuscope.protocols.simulator.family import SimulatorInfo


@dataclass(frozen=True, slots=True)
class SupportTable:
    """One table.

    Args:
        title: its heading.
        about: a sentence or two before it; `code` stands between backquotes.
        head: titles of the columns.
        rows: as many cells each.
    """

    title: str
    about: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class FrameLister(Protocol):
    """Chunks in, lines of plain values out: offset and size, then protocol, id, message and fields, or reject."""

    def feed(self, data: bytes) -> None: ...

    def drain(self, *, stalled: bool = False) -> list[dict[str, Any]]: ...


class OutputChanges(Protocol):
    """Interruptions of a device's output on request, recognised by its answers: they explain missing samples."""

    @property
    def standing(self) -> tuple[int, str] | None:
        """Reason for missing samples that holds now, after its rank: of several reasons the highest counts."""

    def observe(self, reply: Reply) -> tuple[int, str] | None:
        """Reason for samples that are missing around this answer, after its rank."""


@dataclass(frozen=True, slots=True)
class PositionFix:
    """A place on the ellipsoid: degrees, north and east positive; height in m. None: unknown."""

    latitude: float
    longitude: float
    height: float | None = None
    satellites: int | None = None


def position_of_columns(batch: Batch) -> PositionFix | None:
    """The newest position in the columns LatLon and AltitudeEllipsoid."""
    columns = batch.columns
    if "LatLon" not in columns:
        return None
    latitude, longitude = columns["LatLon"][-1].tolist()
    height = float(columns["AltitudeEllipsoid"][-1]) if "AltitudeEllipsoid" in columns else None
    return PositionFix(latitude, longitude, height)


@dataclass(frozen=True, slots=True)
class CorrectionInput:
    """Input of RTCM 3 corrections by devices of a family.

    Args:
        takes: whether this device has a receiver that accepts it.
        wrap: the bytes for one whole message; the address is that of a device on a shared line, else None.
        is_rejection: whether an answer right after it refuses it.
        hint: products that accept it, for devices that do not: "an MTi-680G".
    """

    takes: Callable[[DeviceContext], bool]
    wrap: Callable[[bytes, int | None], bytes] = lambda message, address: message
    is_rejection: Callable[[Reply], bool] = lambda reply: False
    hint: str = ""


@dataclass(frozen=True, slots=True)
class LogHeader:
    """Required header of a log in the vendor's own format.

    Args:
        frames: ids of its answers → their names in the metadata of a recording.
        request: a transaction that requests them from the device.
        title: of the job that does.
        words: display name: "Configuration".
        format: the name of the log format that needs them.
    """

    frames: Mapping[int, str]
    request: Callable[[], Transaction[None]]
    title: str
    words: str
    format: str


@dataclass(frozen=True, slots=True)
class LogName:
    """Information from the name of a log file; a logger's clock has no zone, UTC is assumed. `stem`: of all parts."""

    stem: str
    serial_number: str
    started_ns: int
    part: int


Damage = Callable[[int, str], None]
"""Called with the offset of damage in a file, and a sentence about it."""


@dataclass(frozen=True, slots=True)
class LogFormat:
    """A file format of the vendor.

    Args:
        name: as in the list of recordings and of exports ("mtb").
        suffix: of its files (".mtb").
        title, words: of an export, for display.
        device: whose bytes are exported, for display: "an Xsens device".
        marker: the first bytes of such a file, whatever its name; b"" if there are none of its own.
        certain: whether such a file is always of this family; otherwise its bytes decide.
        packets: converts a file to the bytes sent by a device; None if it holds those.
        read_name: information from the stem of a file's name; a log in parts is read as one.
        read_index: (offsets, ms) of the companion file with the suffix `index_suffix`, ascending; None if it cannot be
            used.
        dated: whether the first bytes of a file contain its start.
        exported: "" for none, "bytes" as received, "frames" alone, after those of the family's `log_header`.
    """

    name: str
    suffix: str
    title: str = ""
    words: str = ""
    device: str = ""
    marker: bytes = b""
    certain: bool = False
    packets: Callable[[bytes, Damage], Iterator[bytes]] | None = None
    read_name: Callable[[str], LogName | None] = lambda stem: None
    read_index: Callable[[bytes], tuple[Ints, Ints] | None] | None = None
    index_suffix: str = ""
    dated: bool = False
    exported: str = ""


@dataclass(frozen=True, slots=True)
class RejectRemedy:
    """A reason for rejecting frames (framing.REASONS) that another decode option would avoid.

    Args:
        words: what happens, in a sentence.
        remedy: what to do, in a sentence; for a live device, which the page shows.
        remedy_of_file: the same for a file; "" for the same.
        listed: the reason in a list of frames.
        needed: what the user has to give; "" for nothing, or several possibilities.
        is_damage: among accepted frames such a one is damaged or forged: it is only counted.
    """

    words: str
    remedy: str
    remedy_of_file: str = ""
    listed: str = ""
    needed: Literal["", "key"] = ""
    is_damage: bool = False


@dataclass(frozen=True, slots=True)
class PayloadDefinition:
    """Definition of a vendor's own payload types by the user.

    Args:
        option: name of the decode option that takes it, a text.
        template: an initial text for a payload, which the user completes. {size} becomes its length in bytes, {id} its
            type in hexadecimal digits, {type} and {count} those of `types`; a line with {count} is left out for one.
        types: (name, bytes) of the numbers that a payload can consist of; the first whose size divides the length is
            used for all of it.
    """

    option: str
    template: str
    types: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class PanelDefaults:
    """Initial arrangement of the page for a device.

    Args:
        plots: titles or names of the plotted quantities, in this order; () lets the page choose by title and unit.
        panels: ids of the panels placed before the others, in this order.
    """

    plots: tuple[str, ...] = ()
    panels: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FamilyHints:
    """Sentences of a family for the page; "" for none.

    Args:
        attitude: what to switch on for an attitude.
        identify: why a device has no name yet, and what helps.
        pause: the cost of reading its settings.
    """

    attitude: str = ""
    identify: str = ""
    pause: str = ""


@dataclass(frozen=True, slots=True)
class FrameFormat:
    """Frames of a protocol: how they are found, listed and made.

    Args:
        likeness: (score 0..1, words) of some bytes.
        listing: makes a parser of a file into lines of plain values, for `imuscope inspect`.
        sample: a few valid bytes.
        scan: finds frames as strictly as possible without a key; for streams of mixed protocols.
        is_certain: for a table of frames and their bytes, which are hardly chance: for a protocol whose only check is
            one byte. None: all.
        rows: rows of its messages, named as its listing prints them: title, text and section of the document.
        composer: makes frames from words and JSON, with the settings of the given options.
        permissive: keywords of a decoder that accepts frames unchecked, for inspecting bytes.
        frame_size: name of a module with a function `frame_size(data, at)` (FrameSize of the shared ports), which
            imports nothing heavy: with it a slow client of a shared port loses whole frames. "" for none.
        configuration_frames: name of a module with a function `effect_of(frame)` (Effect of the shared
            ports), which imports nothing heavy: with it imuscope waits while a client of a shared port configures the
            device, and shows what it changed. "" for none.
    """

    likeness: Callable[[bytes], tuple[float, str]]
    listing: Callable[..., FrameLister]
    sample: bytes
    scan: Scan
    is_certain: Callable[[Ints, Bytes], NDArray[np.bool_]] | None = None
    rows: Callable[[], Iterable[Message]] = lambda: ()
    composer: Callable[[Mapping[str, Any]], ProtocolComposer] | None = None
    permissive: Mapping[str, Any] = field(default_factory=dict)
    frame_size: str = ""
    configuration_frames: str = ""


@dataclass(frozen=True, slots=True)
class Decoding:
    """Decoding of a protocol, and reasons for rejecting its frames.

    Args:
        decoder: makes a decoder; takes `direction` (schema.Direction), the side to read.
        options: information from the user on how to decode, keywords of decoder and listing
            (protocols/family/decode_options.py).
        payload_definition: how the user defines a vendor's own payload types; None if it cannot be done.
        protection: protection of the frames of a batch, in words; None if it is the same for all.
        refusals: reasons for refusing intact frames (framing.REFUSED) → their meaning, and what to do.
        remedies: reasons for rejecting frames that a decode option would avoid → what to do.
        listed_rejects: further reasons in a list of frames, if they depend on an option.
        unprotected: prefix of the protection (`protection`) of frames whose payload is not protected, and what to do
            about them on a network; "" for none.
    """

    decoder: Callable[..., Decoder]
    options: tuple[DecodeOption, ...] = ()
    payload_definition: PayloadDefinition | None = None
    protection: Callable[[Batch], str] | None = None
    refusals: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    remedies: Mapping[str, RejectRemedy] = field(default_factory=dict)
    listed_rejects: Mapping[str, str] = field(default_factory=dict)
    unprotected: tuple[str, str] = ("", "")


@dataclass(frozen=True, slots=True)
class StreamTraits:
    """Properties of the stream of a protocol: datagrams, losses, times.

    Args:
        datagrams: whether the decoder has that keyword: every chunk is a datagram.
        silence: whether its decoder accepts more after a silence: it has the keyword `arrivals` (False: the arrival
            times are not those of a link), and its listing has `feed_chunks`, as decoders do.
        output_changes: recognises interruptions of the output on request; None if samples are not counted.
        stamped: its device time is that of a host's clock, UTC: samples have this time, which is not mapped.
        counts: its samples or frames are numbered, so that lost ones are counted.
        counter: name of the quantity that has the numbers, where a device can be set not to send it; "" for frames that
            always have them.
        utc: UTC of each sample of a batch as reported by the device, ns since the Unix epoch (UNKNOWN of dates.py if
            not reported); None if the device never reports it.
        dated: start of a log, by its head.
        is_offered: False for a stream that only files have: it is not detected, and no choice.
    """

    datagrams: bool = False
    silence: bool = False
    output_changes: Callable[[], OutputChanges] | None = None
    stamped: bool = False
    counts: bool = False
    counter: str = ""
    utc: Callable[[Batch], Ints | None] = lambda batch: None
    dated: Callable[[Reply], int | None] = lambda reply: None
    is_offered: bool = True

    def numbers(self, message: Message) -> bool:
        """Whether the samples of a message are among those that the counter of a device numbers."""
        return not self.counter or any(field.name == self.counter for field in message.fields)


@dataclass(frozen=True, slots=True)
class DeviceTraits:
    """Devices of a protocol: who they are, how they are found, what they have.

    Args:
        identity: identity in an answer of the device: any of "product", "serial_number", "firmware".
        identify_request: harmless request to any device of the protocol for its identity; b"" for none.
        bauds: default rates of its devices' serial lines; a search for the rate tries them first.
        sender: name for senders (Batch.device) if a stream names them: its name is then its serial number, and the
            address of commands.
        absent: flags of its status words, by name, which a product does not have.
        position: the newest position in a batch; None without one.
        sensors: axes and noise of a product's sensors, for programs that need them in messages (ROS).
        usb_vendors, usb_products: names of USB ids.
        host_drivers: beginnings of the names of programs for its devices → where the port is set in them.
    """

    identity: Callable[[Reply], Mapping[str, str]] = lambda reply: {}
    identify_request: bytes = b""
    bauds: tuple[int, ...] = ()
    sender: str = ""
    absent: Callable[[str], tuple[str, ...]] = lambda product: ()
    position: Callable[[Batch], PositionFix | None] = lambda batch: None
    sensors: Callable[[str], SensorProperties] = lambda product: SensorProperties()
    usb_vendors: Mapping[int, str] = field(default_factory=dict)
    usb_products: Mapping[tuple[int, int], str] = field(default_factory=dict)
    host_drivers: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ConfigurationTraits:
    """Configuration of the devices of a protocol.

    Args:
        driver: configures its devices; None if they cannot be configured.
        tables: of its settings with an editor of their own, by its name (schema.Setting.editor); `values` are its
            settings as far as read.
        entry_words: title and value of a record with a key (schema.Field.key_mask), for display; the key alone is
            enough for the title. None for other records.
        corrections: how its devices accept RTCM; None if they do not.
        mounting: the setting that takes a mounting rotation; None if there is none.
    """

    driver: DeviceDriver | None = None
    tables: Callable[[DeviceContext, Mapping[str, Values]], Mapping[str, RateTable]] = lambda known, values: {}
    entry_words: Callable[[Mapping[str, Any]], tuple[str, str] | None] = lambda entry: None
    corrections: CorrectionInput | None = None
    mounting: MountingSetting | None = None


@dataclass(frozen=True, slots=True)
class VendorLogs:
    """The vendor's own files.

    Args:
        log_header, log_formats: of the vendor's own files.
        describing: ids of frames that say how later ones are decoded: a part of a stream begins with the last of each.
    """

    log_header: LogHeader | None = None
    log_formats: tuple[LogFormat, ...] = ()
    describing: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class PageWords:
    """Words and arrangement of the page for a protocol.

    Args:
        short: for narrow places; "" for the name in capitals.
        hints: for the page.
        panels: initial arrangement of the page for a device.
        abbreviations: parts of its names of flags and choices that stay in capitals: "GPX".
        supported: tables of products, firmware and data for the documentation.
        exempt: rules of protocols/family/quality.py that do not apply to the family, each with the reason.
    """

    short: str = ""
    hints: FamilyHints = FamilyHints()
    panels: PanelDefaults = PanelDefaults()
    abbreviations: tuple[str, ...] = ()
    supported: Callable[[], Iterable[SupportTable]] = lambda: ()
    exempt: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ProtocolInfo:
    """One protocol family.

    Args:
        name: as on the command line ("xbus").
        title: display name.
        frames: how its frames are found, listed and made.
        decoding: how they are decoded, and why some are rejected.
        stream: datagrams, losses and times of its stream.
        device: who its devices are, how they are found and what they have.
        configuration: how its devices are configured.
        logs: the vendor's own files.
        page: words and arrangement of the page.
        simulator: its simulated devices; None for none.
    """

    name: str
    title: str
    frames: FrameFormat
    decoding: Decoding
    stream: StreamTraits = StreamTraits()
    device: DeviceTraits = DeviceTraits()
    configuration: ConfigurationTraits = ConfigurationTraits()
    logs: VendorLogs = VendorLogs()
    page: PageWords = PageWords()
    simulator: SimulatorInfo | None = None

    @property
    def short_title(self) -> str:
        """Its name for narrow places."""
        return self.page.short or self.name.upper()

    def settings(self, texts: Mapping[str, str]) -> dict[str, Any]:
        """Settings of its decoder with these decode options; those of other families are left out."""
        return settings_of(self.decoding.options, texts)
