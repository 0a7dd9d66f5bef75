"""Xbus as a family: the only object of this folder that other folders use."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Bytes, Floats, Ints
from imuscope.protocols.clocks.dates import UNKNOWN, utc_ns
from imuscope.protocols.commands.composer import FrameRecord, ProtocolComposer
from imuscope.protocols.commands.mounting import MountingSetting
from imuscope.protocols.commands.rate_tables import KeyVariant, RateRow, RateTable, VariantChoice
from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceRejectedError,
    NoReplyError,
    Transaction,
    Values,
)
from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.family.info import (
    ConfigurationTraits,
    CorrectionInput,
    Decoding,
    DeviceTraits,
    FamilyHints,
    FrameFormat,
    LogFormat,
    LogHeader,
    PageWords,
    ProtocolInfo,
    StreamTraits,
    VendorLogs,
    position_of_columns,
)
from imuscope.protocols.framing.stream_buffer import ID, OFFSET
from imuscope.protocols.rotations import matrix_of, quaternion_of
from imuscope.protocols.simulator.family import SimulatedDevice, SimulatorInfo, SimulatorOption, SimulatorRequest
from imuscope.protocols.simulator.setups import SETUP_OPTIONS, SensorSetup
from imuscope.protocols.xbus import frames, requests
from imuscope.protocols.xbus.binary_strings import EM1000, EM1000_HEAD
from imuscope.protocols.xbus.data_identifiers import BY_NAME as ITEMS
from imuscope.protocols.xbus.data_identifiers import COORDINATES
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.device_info import identity
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.frames import FIX_2D, MASTER, build, scan
from imuscope.protocols.xbus.inspect import XbusFrameLister, detection_score
from imuscope.protocols.xbus.json_codec import frame_from_json
from imuscope.protocols.xbus.messages import BY_NAME, MESSAGES, ROWS
from imuscope.protocols.xbus.output_changes import XbusOutputChanges
from imuscope.protocols.xbus.output_configuration import ALWAYS, OUTPUTS, Output, allowed, max_rate
from imuscope.protocols.xbus.products import absent, as_built, has, model_of, sensors_of
from imuscope.protocols.xbus.supported import supported

UTC_VALID = 4
DATE_AND_TIME_VALID = 3


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample, ns since the Unix epoch, UNKNOWN where absent; None if no sample has it.

    A UtcTime counts if its flags call UTC valid, a solution if it has a fix and a valid date and time of day.

    Source: MT0101P 2020.A, tables 13, 14 and 25.
    """
    names = {field.name for field in batch.message.fields}
    if "UtcTime" in names:
        row = batch.columns["UtcTime"]
        valid = row["flags"] & UTC_VALID != 0
        fields = ("year", "month", "day", "hour", "minute", "second", "ns")
    elif "GnssPvtData" in names:
        row = batch.columns["GnssPvtData"]
        valid = (row["fixtype"] >= FIX_2D) & (row["valid"] & DATE_AND_TIME_VALID == DATE_AND_TIME_VALID)
        fields = ("year", "month", "day", "hour", "min", "sec", "nano")
    else:
        return None
    year, month, day, hour, minute, second, ns = (np.asarray(row[name]).astype(np.int64) for name in fields)
    times = utc_ns(year, month, day, hour, minute, second, ns, valid)
    return times if (times != UNKNOWN).any() else None


def date_of(reply: Reply) -> int | None:
    """Start of a log from the Configuration message in its header, ns since the Unix epoch; None if it is not set.

    Source: MT0101P 2020.A, section 5.3.6: the start date of its writer, to the hundredth of a second.
    """
    if reply.message.name != "Configuration":
        return None
    date, time = (str(reply.values.get(name, "")).strip("\0 ") for name in ("date", "time"))
    try:
        began = datetime.strptime(date + time[:6].ljust(6, "0"), "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    hundredths = int(time[6:8]) if time[6:8].isdecimal() else 0
    return round(began.timestamp()) * 1_000_000_000 + hundredths * 10_000_000 if began.year >= 1999 else None


_NAMES = ("q0", "q1", "q2", "q3")


def _rotated(matrix: Floats, present: Values) -> Values:
    stored = np.array([float(present.get(name, 1.0 if name == "q0" else 0.0)) for name in _NAMES])
    before = matrix_of(stored) if np.linalg.norm(stored) > 0.5 else np.eye(3)
    q = quaternion_of(matrix @ before)
    return dict(zip(_NAMES, (q if q[0] >= 0 else -q).tolist(), strict=True))


# An MTi sends vectors already turned by RotSensor, the rotation from the sensor frame to the object frame, so one that
# was found from them comes on top of it. Source: MT0101P 2020.A, 5.3.5 SetAlignmentRotation; MTi Family Reference
# Manual, MT1600P, alignment resets.
MOUNTING = MountingSetting(
    "AlignmentRotation.RotSensor",
    "q0",
    _rotated,
    "The device then sends vectors and orientation in the axes of the vehicle.",
)


REQ_CONFIGURATION, CONFIGURATION = 0x0C, 0x0D
REQ_EMTS, EMTS_DATA = 0x90, 0x91
_TIMEOUT_S = 1.0


def head() -> Transaction[None]:
    """Request the header messages of a log: its Configuration, and its stored calibration if available.

        FA FF 0D …      Configuration: device id, outputs; without it the vendor's program does not open a log
        FA FF 91 …      EmtsData: the calibration, encrypted; newer devices only

    Both are requested in the config state, so a measuring device pauses (DeviceDriver.within).

    Source: MT0101P 2020.A, 5.3.5; that a log begins with both is known from files of the vendor's program.

    Raises:
        DeviceRejectedError, NoReplyError: no Configuration received.
    """
    yield from requests.send_request(frames.build(REQ_CONFIGURATION), "ReqConfiguration", _TIMEOUT_S)
    with suppress(DeviceRejectedError, NoReplyError):  # most devices do not have it
        yield from requests.send_request(frames.build(REQ_EMTS), "ReqEmts", _TIMEOUT_S, 1)


DRIVER = XbusDriver()
NUMBERS = np.array(sorted(ROWS))
FORWARD_GNSS_DATA, ERROR = 0xE2, 0x42
FORWARDS = "ForwardGnssData"  # a product with this command accepts RTCM
PRECISIONS = ("Float32", "Fp12.20", "Fp16.32", "Float64")
HOST_PORTS = ("rs232", "uart")  # of a 600-series, in the order of the words of its PortConfig
DEFAULT_PRODUCT = "MTi-630"


def _is_certain(table: Ints, data: Bytes) -> NDArray[np.bool_]:
    """Frames that are hardly chance. The check is one byte, so noise contains a frame every 60 kB; only frames from the
    device itself, bus identifier FF, with a known message count: one in some 50 MB.
    """
    certain: NDArray[np.bool_] = (data[table[OFFSET] + 1] == MASTER) & np.isin(table[ID], NUMBERS)
    return certain


def _composer(settings: Mapping[str, Any]) -> ProtocolComposer:
    messages = {name: rows[0].fields for name, rows in BY_NAME.items()}
    forms = {name: tuple(part for row in rows for part in row.fields) for name, rows in BY_NAME.items()}
    forms["MTData2"] = tuple(ITEMS.values())
    return ProtocolComposer(
        "xbus",
        DRIVER,
        messages,
        frame_from_json,
        listed=forms,
        strings={"tss2": None, "em1000": _em1000},
        of_devices=frozenset(name for name, rows in BY_NAME.items() if rows[0].direction == "to_host"),
    )


def _em1000(record: FrameRecord) -> bytes:
    fields = record.get("fields", {})
    angles = (round(fields[name] * 100) for name in ("roll", "pitch", "heave", "heading"))
    return EM1000_HEAD + EM1000.pack(*angles)[len(EM1000_HEAD) :]


# -- forms -------------------------------------------------------------------------------------------------------------


PRECISION = KeyVariant(
    "precision",
    "Precision",
    3,
    [VariantChoice(bits, words) for bits, words in enumerate(("Float32", "Fp12.20", "Fp16.32", "Float64"))],
    "fixed",
)
FRAME = KeyVariant("frame", "Frame", 0xC, [VariantChoice(at << 2, words) for at, words in enumerate(COORDINATES)])


def tables(known: DeviceContext, values: Mapping[str, Values]) -> dict[str, RateTable]:
    """Outputs available in an output configuration of this product.

    Args:
        values: settings as last read.
    """
    model = as_built(model_of(known.product), values.get("HardwareVersion", {}))
    offered = [output for output in OUTPUTS.values() if has(model, output.products)]
    titles = Counter(output.field.title or output.name for output in offered)

    def title_of(output: Output) -> str:
        """Title of an output; of two with the same title the rarer gets its name: "Status", "Status byte"."""
        title = output.field.title or output.name
        spread = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", output.name).capitalize()
        return title if titles[title] == 1 or output.basic else spread

    rows = [
        RateRow(
            id=output.identifier,
            title=title_of(output),
            group=output.group,
            rates=list(allowed(max_rate(output, model))),
            variants={
                one.name: [choice.bits for choice in one.choices]
                for one, has_it in ((PRECISION, output.real), (FRAME, output.local))
                if has_it
            },
            basic=output.basic,
            doc=output.field.doc,
        )
        for output in offered
    ]
    return {
        "outputs": RateTable(
            "data_identifier",
            "output_frequency",
            "Data",
            rows,
            key_mask=0xFFF0,
            key_digits=4,
            every=ALWAYS,
            variants=[PRECISION, FRAME],
        )
    }


def entry_words(entry: Mapping[str, Any]) -> tuple[str, str] | None:
    """Title and value of an entry of an output configuration: the quantity, and "400 Hz", with precision and frame if
    unusual.
    """
    if "data_identifier" not in entry:
        return None
    identifier, rate = int(entry["data_identifier"]), int(entry.get("output_frequency", 0))
    parts = ["with every message" if rate in (0, ALWAYS) else f"{rate} Hz"]
    if identifier & 3:
        parts.append(PRECISIONS[identifier & 3])
    if identifier & 0xC and identifier >> 2 & 3 < len(COORDINATES):
        parts.append(COORDINATES[identifier >> 2 & 3])
    output = OUTPUTS.get(identifier & 0xFFF0)
    title = (output.field.title or output.name) if output is not None else f"0x{identifier:04X}"
    return title, ", ".join(parts)


# -- simulated devices -------------------------------------------------------------------------------------------------


def _products() -> tuple[str, ...]:
    from imuscope.protocols.xbus.simulator.settings import PRODUCTS

    return DEFAULT_PRODUCT, *(name for name in PRODUCTS if name != DEFAULT_PRODUCT)


def _check(product: str, options: Mapping[str, str]) -> tuple[str, str] | None:
    if "port" in options and not product.startswith("MTi-6"):
        return f"an {product} has one port", "Leave port out, or choose a product of the 600-series."
    return None


def _make(request: SimulatorRequest) -> Sequence[SimulatedDevice]:
    from imuscope.protocols.xbus.simulator.device import XbusSimulator
    from imuscope.protocols.xbus.simulator.faults import FaultInjection

    options = request.options
    faults = FaultInjection(
        drop_share=options["mute"],
        corrupt_share=options["wrong"],
        late_ns=round(options["late_ms"] * 1e6),
        power_cut_at=options["cut"],
        ignores_goto_config=bool(options["stubborn"]),
    )
    return [
        XbusSimulator(
            request.product,
            None,
            request.seed + place,
            request.start_ns,
            rate=request.rate,
            clock_drift_ppm=request.clock_drift_ppm,
            clock_jump=request.clock_jump,
            vibration=1.0,
            baud=request.baud,
            port=HOST_PORTS.index(options["port"]),
            moods=faults,
            bid=bid,
            setup=SensorSetup.of(options),
        )
        for place, bid in enumerate(options["bus_ids"] or (None,))
    ]


def _frame_size(head: bytes) -> int:
    """FA BID MID LEN, payload, checksum; LEN 255 is followed by two bytes of length."""
    if len(head) < 4 or (head[3] == 255 and len(head) < 6):
        return 0
    return 5 + head[3] if head[3] != 255 else 7 + (head[4] << 8 | head[5])


SIMULATOR = SimulatorInfo(
    _make,
    lambda rate, options: 88 * rate * (len(options["bus_ids"]) or 1),
    b"\xfa",
    _frame_size,
    "an MTi-630 at 100 Hz",
    _products,
    options=(
        SimulatorOption("port", "choice", HOST_PORTS[0], HOST_PORTS),
        SimulatorOption("bus_ids", "list", (), low=1, high=254, most=4),
        SimulatorOption("stubborn", "whole", 0, high=1),
        SimulatorOption("mute", "number", 0, high=1),
        SimulatorOption("wrong", "number", 0, high=1),
        SimulatorOption("late_ms", "number", 0, high=60_000, unit="ms"),
        SimulatorOption("cut", "whole", 0, high=1_000_000),
        *SETUP_OPTIONS,
    ),
    check=_check,
    usual=True,
    device="an MTi",
)


FAMILY = ProtocolInfo(
    "xbus",
    "Xsens MTi (Xbus)",
    frames=FrameFormat(
        likeness=detection_score,
        listing=XbusFrameLister,
        sample=build(0x36, bytes.fromhex("1020020001")) + build(0x3E),
        scan=scan,
        frame_size="imuscope.protocols.xbus.client_frames",
        configuration_frames="imuscope.protocols.xbus.client_frames",
        is_certain=_is_certain,
        rows=lambda: MESSAGES,
        composer=_composer,
    ),
    decoding=Decoding(
        decoder=XbusDecoder,
    ),
    stream=StreamTraits(
        counts=True,
        counter="PacketCounter",
        output_changes=XbusOutputChanges,
        utc=utc_of,
        dated=date_of,
    ),
    device=DeviceTraits(
        host_drivers={
            "xsens_mti_node": "`port` and `scan_for_devices: false` in xsens_mti_node.yaml",
            "mtnode": "`_device:=` of mtnode.py",
            "mtdevice": "`--device=` of mtdevice.py",
        },
        identity=identity,
        bauds=(115_200,),
        absent=absent,
        position=position_of_columns,
        sensors=sensors_of,
        usb_vendors={0x2639: "Xsens"},
        usb_products={  # Source: Linux drivers/usb/serial/ftdi_sio_ids.h.
            (0x2639, 0x0101): "Xsens Awinda station",
            (0x2639, 0x0102): "Xsens Awinda dongle",
            (0x2639, 0x0200): "Xsens MTw",
            (0x2639, 0x0300): "Xsens MTi development board",
            (0x2639, 0x0301): "Xsens USB converter",
            (0x2639, 0xD00D): "Xsens USB converter",
            (0x0403, 0xD388): "Xsens USB converter",
            (0x0403, 0xD389): "Xsens wireless receiver",
            (0x0403, 0xD38B): "Xsens USB converter",
            (0x0403, 0xD38C): "Xsens wireless receiver",
            (0x0403, 0xD38D): "Xsens Awinda station",
        },
    ),
    configuration=ConfigurationTraits(
        driver=DRIVER,
        tables=tables,
        entry_words=entry_words,
        corrections=CorrectionInput(
            lambda known: bool(known.product) and any(row.name == FORWARDS for row in DRIVER.commands(known)),
            lambda message, address: build(FORWARD_GNSS_DATA, message, MASTER if address is None else address),
            lambda reply: reply.message.id == ERROR,
            "an MTi-680G",
        ),
        mounting=MOUNTING,
    ),
    logs=VendorLogs(
        log_header=LogHeader(
            {CONFIGURATION: "configuration", EMTS_DATA: "emts"},
            head,
            "Read its configuration for the recording",
            "Configuration",
            "mtb",
        ),
        log_formats=(
            LogFormat(
                "mtb",
                ".mtb",
                "MT Manager",
                "for the vendor's MT programs",
                "an Xsens device",
                certain=True,
                dated=True,
                exported="frames",
            ),
        ),
    ),
    page=PageWords(
        short="Xbus",
        hints=FamilyHints(
            attitude="Add Quaternion, RotationMatrix or EulerAngles to the output configuration of the device to show "
            "the horizon.",
            identify="An MTi does not identify itself while measuring. Reading its settings identifies it, and "
            "interrupts its measurement for about a second.",
            pause="Reading the settings of an MTi interrupts its measurement for about a second.",
        ),
        supported=supported,
        exempt={"identity": "An MTi that measures answers no request for its identity."},
    ),
    simulator=SIMULATOR,
)
