"""Opened recordings for tests, made by hand: two devices, quantities at several rates, a table, odd numbers."""

from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.mcap.writer import McapWriter

START = 1_760_000_000.0


def column(name: str, dtype: str, unit: str = "", axis: str = "") -> dict[str, Any]:
    return {"name": name, "dtype": dtype, "unit": unit, "label": "", "doc": f"About {name}.", "axis": axis, "bits": []}


def channel(
    number: int, device: str, message: str, name: str, kind: str, columns: list[dict[str, Any]], **more: Any
) -> dict[str, Any]:
    details = {
        "id": number,
        "device": device,
        "message": message,
        "name": name,
        "title": name,
        "kind": kind,
        "unit": "",
    }
    return {**details, "frame": "", "columns": columns, "doc": "", "source": "", "verified": True, "group": "", **more}


ACCELERATION = channel(
    1, "1", "MTData2", "Acceleration", "vector", [column(axis, "f4", "m/s²", axis) for axis in "xyz"]
)
ANGLES = channel(
    1, "1", "MTData2", "EulerAngles", "euler", [column(name, "f4", "°") for name in ("roll", "pitch", "yaw")]
)
COUNTER = channel(2, "1", "MTData2", "PacketCounter", "counter", [column("value", "u2")])
TEMPERATURE = channel(3, "1", "MTData2", "Temperature", "scalar", [column("value", "f8", "°C")])
SATELLITES = channel(4, "1", "MTData2", "GnssSatInfo", "table", [column("svid", "u1"), column("cno", "u1", "dBHz")])
STATUS = channel(5, "2", "DID_INS_1", "DID_INS_1", "record", [column("insStatus", "u4"), column("big", "i8")])


def store(folder: Path, n: int = 1000, rate: float = 100.0, devices: int = 2) -> ColumnStore:
    """N samples of a fast message, every tenth with a temperature, satellites once a second, another device."""
    rng = np.random.default_rng(3)
    writer = ColumnStoreWriter(folder)
    infos = [ACCELERATION, COUNTER, TEMPERATURE, SATELLITES, STATUS][: 4 if devices == 1 else 5]
    for info in infos:
        dtypes = tuple(one["dtype"] for one in info["columns"])
        writer.channel(info["id"], ChannelLayout(dtypes, (False,) * len(dtypes)))
    time = START + np.arange(n) / rate
    arrival = time + 0.002
    vector = rng.normal(size=(3, n)).astype(np.float32)
    vector[0, :: max(n // 7, 1)] = np.nan
    vector[1, 5 % n] = np.inf
    writer.append(1, [arrival, time, *vector])
    writer.append(2, [arrival, time, np.arange(n).astype(np.uint16)])
    writer.append(3, [arrival[::10], time[::10], rng.normal(size=len(time[::10])) + 20])
    every = max(int(rate), 1)
    seconds = np.repeat(time[::every], 3)
    few = np.arange(len(seconds)).astype(np.uint8)
    writer.append(4, [seconds + 0.002, seconds, few, few])
    if devices == 2:
        own = np.full(n // 2, np.nan)
        writer.append(5, [arrival[: n // 2], own, np.arange(n // 2) % 7, np.arange(n // 2) - 2**60])
    about = [
        {"id": "1", "name": "MTi-630", "protocol": "xbus", "product": "MTi-630", "serial_number": "0080A1B2"},
        {"id": "2", "name": "IMX-5", "protocol": "isb", "product": "IMX-5", "serial_number": "60339"},
    ]
    events = [{"kind": "gap", "t0": START + 1.0, "t1": START + 1.1}]
    details = {"channels": infos, "devices": about[:devices], "started": START, "ended": float(arrival[-1])}
    more = {
        "events": events,
        "markers": [{"text": "kerb", "time": START + 2.0}],
        "damage": [],
        "format": "mcap",
        "figures": {},
    }
    return writer.finish({**details, **more})


NS = round(START * 1e9)


def recording(path: Path, title: str = "Yard loop", start: int = NS) -> Path:
    """A recording of an MTi with a marker."""
    writer = McapWriter(path, {"title": title})
    writer.device("1", {"protocol": "xbus", "name": "MTi-630", "serial_number": "0080A1B2"})
    for n in range(10):
        writer.chunk("1", "rx", bytes.fromhex("FAFF3E00C3"), start + n * 100_000_000)
    writer.write_note("marker", "kerb", start)
    writer.close()
    return path
