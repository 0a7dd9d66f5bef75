"""Inertial Sense as a family: the only object of this folder that other folders use."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import radians, sqrt
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.dates import UNKNOWN
from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.commands.mounting import MountingSetting
from imuscope.protocols.commands.rate_tables import RateRow, RateTable
from imuscope.protocols.commands.transactions import DeviceContext, Values
from imuscope.protocols.events import Batch
from imuscope.protocols.family.info import (
    ConfigurationTraits,
    CorrectionInput,
    Decoding,
    DeviceTraits,
    FamilyHints,
    FrameFormat,
    LogFormat,
    PageWords,
    PositionFix,
    ProtocolInfo,
    StreamTraits,
    SupportTable,
    VendorLogs,
)
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.isb import logs
from imuscope.protocols.isb.bandwidth import periods_ms
from imuscope.protocols.isb.commands import COMMAND_ROWS, NMEA_MESSAGES
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS, VERSIONS, DataSet
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.device_info import FAMILIES, identity
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.frames import DATA, build, get_data, scan, stop
from imuscope.protocols.isb.inspect import IsbFrameLister, detection_score
from imuscope.protocols.isb.json_codec import elements, frame_from_json
from imuscope.protocols.isb.messages import BY_NAME, COMMANDS, DEVICE_INFOS, ROWS, set_row
from imuscope.protocols.isb.stored_settings import STORED
from imuscope.protocols.isb.streams import OF_GPX, STREAMS, every, stream_words
from imuscope.protocols.isb.time_base import FIRST_WEEK, GPS_EPOCH, WEEK_S, S
from imuscope.protocols.rotations import euler_columns
from imuscope.protocols.simulator.family import SimulatedDevice, SimulatorInfo, SimulatorOption, SimulatorRequest
from imuscope.protocols.simulator.setups import SETUP_OPTIONS, SensorSetup

DATED_NS = (GPS_EPOCH + FIRST_WEEK * WEEK_S) * S  # up-times are far smaller


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample, ns since the Unix epoch, UNKNOWN before the first fix (time_base.py); None if none is
    known.
    """
    if batch.time_ns is None or not len(batch) or int(batch.time_ns.max()) < DATED_NS:
        return None
    return np.where(batch.time_ns >= DATED_NS, batch.time_ns, UNKNOWN)


def _rotated(matrix: Floats, present: Values) -> Values:
    del present
    return {"insRotation": frame_angles(matrix).tolist()}


def frame_angles(matrix: Floats) -> Floats:
    """Angles about x, y, z, rad, that turn the frame of a vector, about z first, into that of matrix · vector."""
    return np.radians(euler_columns(list(matrix.T.ravel())))


# insRotation turns the sensor frame into the output frame of the navigation, about z, then y, then x. Inertial data
# stay in the sensor frame, so the rotation that was found from them replaces the stored one.
# Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t; ISB document, "Setting Data".
MOUNTING = MountingSetting(
    "DID_FLASH_CONFIG",
    "insRotation",
    _rotated,
    "Attitude and velocity are then those of the vehicle; inertial data stay in the axes of the sensor.",
)


# The makers compute the standard deviation of a sample as random walk × √rate; a density is √2 of that, because its
# standard deviation is density × √(rate / 2).
# Source: docs.inertialsense.com, IMU Specifications; axes of the body (x forward, y right, z down): data_sets.h.
_PER_ROOT_SECOND = sqrt(2) / 60  # density of a random walk per √h
_IMX_5 = SensorProperties(
    "FRD",
    turn=radians(0.16) * _PER_ROOT_SECOND,
    acceleration=0.02 * _PER_ROOT_SECOND,
    turn_bias=radians(1.5 / 3600),
    acceleration_bias=19 * 9.80665e-6,
)


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product, by its name: "IMX-5.0.4"."""
    return _IMX_5 if re.match(r"IMX-5\b", product) else SensorProperties("FRD")


RESERVED = ("DID_NULL", "DID_UNUSED")


def supported() -> Iterator[SupportTable]:
    """Families, firmware, data sets."""
    yield SupportTable(
        "Devices",
        "Read from `DID_DEV_INFO`; the page shows the hardware version after the name, as in IMX-5.0.4.",
        ("family", "hardware type"),
        tuple((name, str(number)) for number, name in FAMILIES.items()),
    )
    yield SupportTable(
        "Firmware",
        "The layout of every public data set is known for these versions. Payloads of other versions are decoded by "
        f"the layout of {CURRENT}, as far as the payload size allows.",
        ("version",),
        tuple((version,) for version in VERSIONS if version[0].isdigit()),
    )
    yield SupportTable(
        "Data sets",
        "Every data set can be read, and written where the device permits it. A setting is read, compared, written and "
        "restored on the Configure page. A data set without a public layout is shown as bytes. Together with the "
        f"commands of the device these are {len(COMMAND_ROWS)} commands.",
        ("DID", "name", "contents", "fields", "streams", "setting"),
        tuple(_row(number, dataset) for number, dataset in SETS.items() if not dataset.name.startswith(RESERVED)),
    )


def _row(number: int, dataset: DataSet) -> tuple[str, ...]:
    fields = str(len(dataset.struct.places)) if dataset.struct else "bytes"
    setting = "" if number not in STORED else "yes" if STORED[number].write else "read only"
    title = STORED[number].title if number in STORED else ROWS[number].title
    return (str(number), f"`{dataset.name}`", title, fields, "yes" if number in STREAMS else "", setting)


DRIVER = IsbDriver()
POSITION_SETS = ("DID_GPS1_POS", "DID_INS_1", "DID_INS_2")


def _composer(settings: Mapping[str, Any]) -> ProtocolComposer:
    messages = {name: row.fields for name, row in BY_NAME.items()}
    messages |= {row.name: row.fields for row in map(set_row, range(256))}
    messages |= {row.name: row.fields for row in COMMANDS.values()}
    return ProtocolComposer("isb", DRIVER, messages, frame_from_json, numbered=False, elements=elements)


def _position(batch: Batch) -> PositionFix | None:
    """Position from lla, once the week is known."""
    columns = batch.columns
    if batch.message.name not in POSITION_SETS or not ("lla" in columns and "week" in columns):
        return None
    if columns["week"][-1] <= 0:
        return None
    latitude, longitude, height = columns["lla"][-1].tolist()
    satellites = int(columns["satsUsed"][-1]) if "satsUsed" in columns else None
    return PositionFix(latitude, longitude, height, satellites)


DIVISORS = (1, 2, 3, 4, 5, 8, 10, 15, 20, 25, 50, 75, 100, 200, 500, 1000)


def tables(known: DeviceContext, values: Mapping[str, Values]) -> dict[str, RateTable]:
    """Streams available on this device: a data set each, at a multiple of its source's period."""
    periods = periods_ms(values)
    gpx = known.product.startswith("GPX")
    rows = [
        RateRow(
            id=stream.did,
            name=stream.name,
            title=stream.title,
            group=stream.group,
            interval_ms=periods[stream.did],
            basic=stream.basic,
        )
        for stream in STREAMS.values()
        if not gpx or stream.did in OF_GPX
    ]
    table = RateTable("did", "period", "Data set", rows, interval="source_ms", divisors=list(DIVISORS), grouped=True)
    return {"streams": table}


def entry_words(entry: Mapping[str, Any]) -> tuple[str, str] | None:
    """Title and value of a stream ("INS 2", "50 Hz") or of a sentence ("NMEA GGA", "1 in 5")."""
    if "did" in entry:
        return stream_words(entry)
    if "msgID" not in entry:
        return None
    number, period = int(entry["msgID"]), int(entry.get("msgPeriod", 0))
    return f"NMEA {NMEA_MESSAGES.get(number, number)}", every(period) if period else "off"


# -- simulated devices -------------------------------------------------------------------------------------------------


def _make(request: SimulatorRequest) -> Sequence[SimulatedDevice]:
    from imuscope.protocols.isb.simulator.device import IsbSimulator
    from imuscope.protocols.isb.simulator.gpx import GpxSimulator

    made = GpxSimulator if request.product.startswith("GPX") else IsbSimulator
    return [
        made(
            product=request.product,
            rate=request.rate,
            seed=request.seed,
            start_ns=request.start_ns,
            clock_drift_ppm=request.clock_drift_ppm,
            clock_jump=request.clock_jump,
            imu_source=request.options["imu_source"],
            vibration=1.0,
            baud=request.baud,
            setup=SensorSetup.of(request.options),
        )
    ]


def _frame_size(head: bytes) -> int:
    """EF 49 FLAGS ID SIZE (2), payload, two sums."""
    return 8 + (head[4] | head[5] << 8) if len(head) >= 6 else 0


SIMULATOR = SimulatorInfo(
    _make,
    lambda rate, options: 132 * rate + 8_000,
    b"\xef\x49",
    _frame_size,
    "an IMX-5 at 100 Hz",
    lambda: ("IMX-5", "GPX-1"),
    least_baud=921_600,
    options=(SimulatorOption("imu_source", "choice", "nav", ("nav", "imu")), *SETUP_OPTIONS),
    usual=True,
    device="an IMX-5",
)


FAMILY = ProtocolInfo(
    "isb",
    "Inertial Sense IMX, GPX (ISB 2.x)",
    frames=FrameFormat(
        likeness=detection_score,
        listing=IsbFrameLister,
        sample=2 * build(DATA, 58, bytes(36)) + stop(),
        scan=scan,
        frame_size="imuscope.protocols.isb.client_frames",
        configuration_frames="imuscope.protocols.isb.client_frames",
        rows=lambda: [*ROWS.values(), *COMMANDS.values()],
        composer=_composer,
    ),
    decoding=Decoding(
        decoder=IsbDecoder,
    ),
    stream=StreamTraits(
        utc=utc_of,
    ),
    device=DeviceTraits(
        host_drivers={
            "inertial_sense_": "`port` in its parameter file (YAML); of SDK 2.7 the address of a tcp:// share",
            "cltool": "`-c` of cltool; from 2.7 on the address of a tcp:// share",
        },
        identity=identity,
        identify_request=get_data(1, period=0),
        bauds=(921_600,),
        position=_position,
        sensors=sensors_of,
    ),
    configuration=ConfigurationTraits(
        driver=DRIVER,
        tables=tables,
        entry_words=entry_words,
        corrections=CorrectionInput(lambda known: True, hint="any Inertial Sense device"),
        mounting=MOUNTING,
    ),
    logs=VendorLogs(
        describing=DEVICE_INFOS,
        log_formats=(
            LogFormat(
                "raw",
                ".raw",
                "Inertial Sense log",
                "for the vendor's Inertial Sense tools",
                "an Inertial Sense device",
                read_name=logs.read_name,
                read_index=logs.read_index,
                index_suffix=".idx",
                exported="bytes",
            ),
            LogFormat(
                "dat",
                ".dat",
                marker=logs.MARKER,
                certain=True,
                packets=logs.packets,
                read_name=logs.read_name,
            ),
        ),
    ),
    page=PageWords(
        short="ISB",
        hints=FamilyHints(attitude="Stream INS 1, INS 2, INS 3 or INS 4 to show the horizon."),
        abbreviations=("GPX",),
        supported=supported,
        exempt={"losses": "Data sets are not numbered; losses show in the times of the device."},
    ),
    simulator=SIMULATOR,
)
