"""MIP as a protocol family: the object named by the entry point."""

from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.plugin import (
    Batch,
    ConfigurationTraits,
    Decoding,
    DeviceTraits,
    FamilyHints,
    Field,
    FrameFormat,
    PageWords,
    PanelDefaults,
    PositionFix,
    ProtocolComposer,
    ProtocolInfo,
    SimulatedDevice,
    SimulatorInfo,
    SimulatorRequest,
)
from imuscope_mip.decoder import MipDecoder, MipLister, detection_score
from imuscope_mip.driver import IDENTIFY_REQUEST, MipDriver, identity
from imuscope_mip.json_codec import frame_from_json
from imuscope_mip.messages import ROWS
from imuscope_mip.options import OPTIONS
from imuscope_mip.packets import HEADER, SUM, SYNC, build, scan

DRIVER = MipDriver()
USB_VENDOR = 0x199B
BYTES_A_SAMPLE = 152


def _composer(settings: Mapping[str, Any]) -> ProtocolComposer:
    single = {row.name: row.fields for row in ROWS}
    fields: dict[str, Field] = {field.name: field for row in ROWS for field in row.fields}
    messages = _AnyPacket(single, tuple(fields.values()))
    return ProtocolComposer("mip", DRIVER, messages, frame_from_json, numbered=False)


class _AnyPacket(dict[str, tuple[Field, ...]]):
    """Fields by packet name, which joins the names of its fields."""

    def __init__(self, single: Mapping[str, tuple[Field, ...]], every: tuple[Field, ...]) -> None:
        super().__init__(single)
        self._every = every

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and all(super(_AnyPacket, self).__contains__(part) for part in name.split("+"))

    def get(self, name: str, default: Any = None) -> Any:
        return tuple(field for part in name.split("+") for field in self[part]) if name in self else default


def _position(batch: Batch) -> PositionFix | None:
    columns = batch.columns
    if "LatLon" not in columns or not columns["position_valid"][-1] & 1:
        return None
    latitude, longitude = columns["LatLon"][-1].tolist()
    return PositionFix(latitude, longitude, float(columns["Height"][-1]))


def _make(request: SimulatorRequest) -> Sequence[SimulatedDevice]:
    from imuscope_mip.simulator import MipSimulator

    return [
        MipSimulator(
            rate=request.rate,
            seed=request.seed,
            start_ns=request.start_ns,
            baud=request.baud,
            clock_drift_ppm=request.clock_drift_ppm,
            clock_jump=request.clock_jump,
        )
    ]


def _frame_size(head: bytes) -> int:
    return HEADER + head[3] + SUM if len(head) >= HEADER else 0


FAMILY = ProtocolInfo(
    "mip",
    "MicroStrain MIP",
    frames=FrameFormat(
        likeness=detection_score,
        listing=MipLister,
        sample=build(0x80, [(0x04, bytes(12))]),
        scan=scan,
        composer=_composer,
    ),
    decoding=Decoding(
        decoder=MipDecoder,
        options=OPTIONS,
    ),
    device=DeviceTraits(
        identity=identity,
        identify_request=IDENTIFY_REQUEST,
        bauds=(115_200,),
        position=_position,
        usb_vendors={USB_VENDOR: "MicroStrain"},
    ),
    configuration=ConfigurationTraits(
        driver=DRIVER,
    ),
    page=PageWords(
        short="MIP",
        hints=FamilyHints(attitude="Configure the device to send its orientation to show the horizon."),
        panels=PanelDefaults(plots=("Acceleration", "RateOfTurn", "EulerAngles", "Height")),
    ),
    simulator=SimulatorInfo(
        _make,
        lambda rate, options: BYTES_A_SAMPLE * rate,
        SYNC,
        _frame_size,
        "a 3DM-GX5-45 at 100 Hz",
        lambda: ("3DM-GX5-45",),
        device="a 3DM-GX5-45",
    ),
)
