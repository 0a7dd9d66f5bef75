"""Inertial Sense as a family: the only object of this folder that other folders use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.protocols.commands.composer import ProtocolComposer
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
    VendorLogs,
)
from imuscope.protocols.isb import logs
from imuscope.protocols.isb.bandwidth import periods_ms
from imuscope.protocols.isb.commands import NMEA_MESSAGES
from imuscope.protocols.isb.dates import utc_of
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.device_info import identity
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.frames import DATA, build, get_data, scan, stop
from imuscope.protocols.isb.inspect import IsbFrameLister, detection_score
from imuscope.protocols.isb.json_codec import elements, frame_from_json
from imuscope.protocols.isb.messages import BY_NAME, COMMANDS, ROWS, set_row
from imuscope.protocols.isb.mounting import MOUNTING
from imuscope.protocols.isb.sensors import sensors_of
from imuscope.protocols.isb.streams import OF_GPX, STREAMS, every, stream_words
from imuscope.protocols.isb.supported import supported
from imuscope.protocols.simulator.family import SimulatedDevice, SimulatorInfo, SimulatorOption, SimulatorRequest
from imuscope.protocols.simulator.setups import SETUP_OPTIONS, SensorSetup

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
