"""Products and stored settings of the simulated MTi.

Two tables. `PRODUCTS`: differences between MTi products on the wire. `SETTINGS`: messages with one number for reading
and setting (section 5.2): an empty one reads, any other sets, and the device returns the stored value.

Rules for editing: identifiers, codes and versions are invented in the form of real ones; rates and capabilities are the
document's (tables 2 and 16). In an output configuration −1 stands for the requested rate, ALWAYS for "with every
message".

Source: MT0101P 2020.A; sizes of the answers from the vendor's public code.
"""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from imuscope.protocols.xbus.config_effects import BAUD_RATES
from imuscope.protocols.xbus.enums import GNSS_PLATFORMS
from imuscope.protocols.xbus.output_configuration import ALWAYS
from imuscope.protocols.xbus.product_options import LONGEST_PERIOD
from imuscope.protocols.xbus.products import ALL, CLASSIC, FILTER, ONE, RTK, SIX, Model, model_of

ERROR_PERIOD, ERROR_MESSAGE, ERROR_BAUD, ERROR_PARAMETER = 3, 4, 32, 33  # table 5
BAUDRATE, PORT_CONFIG, LOCATION, STRINGS, PERIOD, SKIP = 0x18, 0x8C, 0x84, 0x8E, 0x04, 0xD4
OPTIONS, SYNC, ALIGNMENT = 0x48, 0x2C, 0xEC
WRAP_DAY = 864_000_000


class RequestRefusedError(Exception):
    """A request that the device answers with Error `code`."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


_ACCOMPANY = ((0x1020, ALWAYS), (0x1060, ALWAYS))
_INERTIAL = ((0x4020, -1), (0x8020, -1), (0xC020, -1), (0xE020, ALWAYS))
_SLOW = ((0x3010, 50), (0x0810, 1))
_PLACE = ((0x5042, 10), (0x5022, 10), (0xD010, 10), (0x7010, 4), (0x7020, 1))


@dataclass(frozen=True, slots=True)
class SimulatedProduct:
    """Properties of one simulated MTi.

    Args:
        series: 1, 10, 100 or 600.
        capabilities: required by items: "orientation", "baro", "gnss", "rtk"; "selftest" if the status has that bit.
        profiles: filter profiles, (number, label).
        output: its initial output configuration here: more than the factory's, for a full page.
    """

    name: str
    code: str
    series: int
    first_serial: int
    capabilities: frozenset[str]
    firmware: tuple[int, int, int, int, int]
    hardware: tuple[int, int]
    profiles: tuple[tuple[int, str], ...]
    profile: str
    output: tuple[tuple[int, int], ...]

    @property
    def model(self) -> Model:
        """Its row among the document's products."""
        model = model_of(self.name)
        assert model is not None
        return model

    @property
    def wrap(self) -> int:
        """Ticks at which SampleTimeFine wraps (5.3.6)."""
        return WRAP_DAY if self.series in (10, 100) else 2**32


_SERIES: Mapping[int, tuple[str, int, tuple[int, int, int, int, int], tuple[int, int]]] = {
    1: ("8A7G6", 0x00880000, (1, 18, 2, 120, 0x5A310C), (3, 1)),
    10: ("2A8G4", 0x00680000, (1, 12, 0, 87, 0x4F1D22), (2, 0)),
    100: ("2A8G4", 0x00780000, (1, 12, 0, 87, 0x4F1D22), (2, 0)),
    600: ("8A1G6", 0x80800000, (1, 12, 0, 69, 0x6B21F0), (2, 1)),  # bit 31 marks an identifier of 64 bits
}


def _first_serial(name: str, series: int, base: int) -> int:
    """The vendor's scheme: the first digit of the product's number is bits 27:24, except for the 600-series."""
    digit = int(name.rpartition("-")[2].rstrip("G")[0])
    return base if series == 600 else base | digit << 24


_VRU = ((54, "VRU_general"),)
_CLASSIC = ((39, "General"), (40, "High_mag_dep"), (41, "Dynamic"), (42, "Low_mag_dep"), (43, "VRU_general"))
_ONE = ((50, "General"), (51, "High_mag_dep"), (52, "Dynamic"), (53, "North_reference"), (54, "VRU_general"))
_BASE = ((1, "Responsive"), (2, "Robust"), (3, "General"))
_HEADINGS = (
    (4, "NorthReference"),
    (5, "VRU"),
    (6, "VRUAHS"),
    (7, "FixedMagRef"),
)  # five rows are listed, all are accepted
_GNSS = ((1, "General"), (2, "GeneralNoBaro"), (3, "GeneralMag"))


def _product(
    name: str, series: int, kind: str, profiles: tuple[tuple[int, str], ...] = (), profile: str = ""
) -> SimulatedProduct:
    ending, serial, firmware, hardware = _SERIES[series]
    orientation = kind != "IMU"
    gnss, rtk = kind in ("GNSS", "RTK"), kind == "RTK"
    baro = series in (100, 600) or gnss
    abilities = {
        word
        for word, has in (
            ("orientation", orientation),
            ("baro", baro),
            ("gnss", gnss),
            ("rtk", rtk),
            ("selftest", series != 600),
        )
        if has
    }
    items = (*_ACCOMPANY, *(((0x2010, -1),) if orientation else ()), *_INERTIAL)
    items += tuple(item for item in _SLOW if baro or item[0] != 0x3010)
    items += tuple(item for item in _PLACE if series != 1 or item[0] != 0x7020) if gnss else ()
    return SimulatedProduct(
        name,
        f"{name}-{ending}",
        series,
        _first_serial(name, series, serial),
        frozenset(abilities),
        firmware,
        hardware,
        profiles,
        profile,
        items,
    )


PRODUCTS: Mapping[str, SimulatedProduct] = {
    product.name: product
    for product in (
        _product("MTi-630", 600, "AHRS", (*_BASE, *_HEADINGS), "Responsive/NorthReference"),
        _product("MTi-680G", 600, "RTK", tuple((n, f"{label}_RTK") for n, label in _GNSS), "General_RTK"),
        _product("MTi-670", 600, "GNSS", _GNSS, "General"),
        _product("MTi-620", 600, "VRU", (*_BASE, (4, "VRU"), (5, "VRUAHS")), "Responsive/VRU"),
        _product("MTi-610", 600, "IMU"),
        _product("MTi-1", 1, "IMU"),
        _product("MTi-2", 1, "VRU", _VRU, "54"),
        _product("MTi-3", 1, "AHRS", _ONE, "50"),
        _product("MTi-7", 1, "GNSS", ((11, "General"), (12, "GeneralNoBaro"), (13, "GeneralMag")), "11"),
        _product("MTi-10", 10, "IMU"),
        _product("MTi-20", 10, "VRU", ((43, "VRU_general"),), "43"),
        _product("MTi-30", 10, "AHRS", _CLASSIC, "39"),
        _product("MTi-100", 100, "IMU"),
        _product("MTi-200", 100, "VRU", ((43, "VRU_general"),), "43"),
        _product("MTi-300", 100, "AHRS", _CLASSIC, "39"),
        _product("MTi-G-710", 100, "GNSS", (*_GNSS, (4, "Automotive"), (5, "HighPerformanceEDR")), "1"),
    )
}


# -- settings that are stored and returned -----------------------------------------------------------------------------


def _any(payload: bytes, product: SimulatedProduct) -> bool:
    return True


def _keep(payload: bytes, before: bytes) -> bytes:
    return payload


@dataclass(frozen=True, slots=True)
class SimulatedSetting:
    """A setting that is only stored.

    Args:
        name: of the request without Req or Set.
        factory: its value in a new device.
        sizes: payload sizes that set it.
        products: products that have it.
        valid: whether a payload of such a size is allowed; otherwise Error `error`.
        store: from payload and the value before to the value returned afterwards.
        readable: whether it can be read.
    """

    name: str
    factory: Callable[[SimulatedProduct], bytes]
    sizes: frozenset[int]
    products: frozenset[int] = ALL
    valid: Callable[[bytes, SimulatedProduct], bool] = _any
    error: int = ERROR_PARAMETER
    store: Callable[[bytes, bytes], bytes] = _keep
    readable: bool = True

    def accepts(self, size: int, product: SimulatedProduct) -> bool:
        """Whether a payload of this size sets it. If there are two sizes, the longer one is that of the 600-series."""
        if len(self.sizes) == 2:
            return size == (max(self.sizes) if product.series == 600 else min(self.sizes))
        return size in self.sizes


def _is_baud(payload: bytes, product: SimulatedProduct) -> bool:
    return payload[0] in BAUD_RATES


def _are_ports(payload: bytes, product: SimulatedProduct) -> bool:
    """The two host ports; the third word is the receiver's own."""
    words = [word for (word,) in struct.iter_unpack(">I", payload)]
    return all(word & 0xFF in BAUD_RATES and word >> 16 & 0xF in (0, 1, 5) for word in words[:2])


def _is_place(payload: bytes, product: SimulatedProduct) -> bool:
    latitude, longitude, altitude = struct.unpack(">3d", payload)
    return bool(abs(latitude) <= 90 and abs(longitude) <= 180 and math.isfinite(altitude))


def _is_profile(payload: bytes, product: SimulatedProduct) -> bool:
    if product.series != 600:
        return len(payload) == 2 and any(payload == bytes([0, number]) for number, _ in product.profiles)
    known = {label.encode() for _, label in product.profiles}
    return all(part in known for part in payload.split(b"/"))


def _first_profile(product: SimulatedProduct) -> bytes:
    return product.profile.encode() if product.series == 600 else bytes([1, int(product.profile or 0)])


def _keep_profile(payload: bytes, before: bytes) -> bytes:
    """A classic device returns version and number (bytes), a modern one the labels."""
    return bytes([before[0], payload[1]]) if len(payload) == len(before) == 2 else payload


def _between(low: float, high: float, form: str = ">H") -> Callable[[bytes, SimulatedProduct], bool]:
    """All numbers of the payload within a range; NaN is not."""
    return lambda payload, product: all(low <= one <= high for (one,) in struct.iter_unpack(form, payload))


def _is_period(payload: bytes, product: SimulatedProduct) -> bool:
    """Within the table; or longer than 10 ms, as a whole multiple of it (5.3.5)."""
    period = int.from_bytes(payload, "big")
    return 225 <= period <= LONGEST_PERIOD or (period > LONGEST_PERIOD and period % LONGEST_PERIOD == 0)


def _is_platform(payload: bytes, product: SimulatedProduct) -> bool:
    return int.from_bytes(payload, "big") in GNSS_PLATFORMS


def _are_can_outputs(payload: bytes, product: SimulatedProduct) -> bool:
    return all(form <= 1 for _, form, _, _ in struct.iter_unpack(">BBIH", payload))


def _keep_can_outputs(payload: bytes, before: bytes) -> bytes:
    """One entry of zeros clears the list: an empty message would only read it."""
    return payload if any(payload) else b""


def _strings(product: SimulatedProduct) -> bytes:
    return bytes(6 if product.series == 600 else 2)


def _word(value: int) -> Callable[[SimulatedProduct], bytes]:
    return lambda product: struct.pack(">H", value)


_UNITY = struct.pack(">4f", 1, 0, 0, 0)
_PLACE_STORED = struct.pack(">3d", 45.0, 0.0, 60.0)
_BYTE, _TWO, _FOUR = frozenset({1}), frozenset({2}), frozenset({4})
_PORTS = struct.pack(">3I", 0x10002, 0x10002, 0)

SETTINGS: Mapping[int, SimulatedSetting] = {
    BAUDRATE: SimulatedSetting("Baudrate", lambda p: b"\x02", _BYTE, ALL, _is_baud, ERROR_BAUD),
    LOCATION: SimulatedSetting("LocationID", _word(0), _TWO),
    0xDC: SimulatedSetting("TransmitDelay", _word(590), _TWO, CLASSIC, _between(590, 0xFFFF)),
    STRINGS: SimulatedSetting("StringOutputType", _strings, frozenset({2, 6}), ALL - ONE),
    PERIOD: SimulatedSetting("Period", _word(1152), _TWO, CLASSIC, _is_period, ERROR_PERIOD),
    SKIP: SimulatedSetting("OutputSkipFactor", _word(0), _TWO, CLASSIC),
    0x86: SimulatedSetting("ExtOutputMode", _word(0), _TWO, CLASSIC),
    PORT_CONFIG: SimulatedSetting("PortConfig", lambda p: _PORTS, frozenset({12}), SIX, _are_ports, ERROR_BAUD),
    0xE8: SimulatedSetting(
        "CanOutputConfig",
        lambda p: b"",
        frozenset(range(8, 129, 8)),
        SIX,
        _are_can_outputs,
        store=_keep_can_outputs,
    ),
    0xE6: SimulatedSetting("CanConfig", lambda p: struct.pack(">I", 0x0C), _FOUR, SIX),
    0x6E: SimulatedSetting("LatLonAlt", lambda p: _PLACE_STORED, frozenset({24}), ALL, _is_place),
    0x64: SimulatedSetting(
        "FilterProfile", _first_profile, frozenset(range(1, 63)), FILTER, _is_profile, ERROR_PARAMETER, _keep_profile
    ),
    0x76: SimulatedSetting("GnssPlatform", _word(0), _TWO, frozenset({7, 710}), _is_platform),
    0x68: SimulatedSetting("GnssLeverArm", lambda p: bytes(12), frozenset({12}), RTK, _between(-1e9, 1e9, ">f")),
    0xD6: SimulatedSetting(
        "InitialHeading",
        lambda p: bytes(4),
        _FOUR,
        frozenset({710, 670, 680}),
        _between(-180, 180, ">f"),
        readable=False,
    ),
}

KEPT_BY_ACTIONS: Mapping[int, bytes] = {
    OPTIONS: bytes(4),
    SYNC: b"",
    ALIGNMENT: b"\0" + _UNITY + b"\1" + _UNITY,
}


def factory_settings(product: SimulatedProduct) -> dict[int, bytes]:
    """All settings of a new device, by message number."""
    return {mid: setting.factory(product) for mid, setting in SETTINGS.items()} | dict(KEPT_BY_ACTIONS)


NEVER = 0xFFFF  # skip factor: nothing is sent spontaneously


def strings_of(settings: Mapping[int, bytes], product: SimulatedProduct) -> tuple[int, float]:
    """Strings sent instead of data, and their rate."""
    word = settings[STRINGS]
    if product.series == 600:
        return int.from_bytes(word[:4], "big"), float(int.from_bytes(word[4:], "big"))
    period, skip = (int.from_bytes(settings[mid], "big") for mid in (PERIOD, SKIP))
    return int.from_bytes(word, "big"), 0.0 if skip == NEVER else 115_200 / (period * (skip + 1))
