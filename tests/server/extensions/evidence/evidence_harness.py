"""Evidence files for tests: a store with positions, the file made of it, and what is embedded in that."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.server.extensions.evidence.content import About
from imuscope.server.extensions.evidence.request import EvidenceRequest
from imuscope.server.extensions.evidence.worker import write
from tests.recordings.store_fixtures import START, channel, column

LATITUDE, LONGITUDE = 52.2203184, 6.8955273
ECEF = (3_886_213.25, 469_991.5, 5_018_522.75)


def number_column(name: str, dtype: str, unit: str = "", axis: str = "", decimals: int = -1) -> dict[str, Any]:
    return {**column(name, dtype, unit, axis), "choices": {}, "decimals": decimals, "period": 0.0}


CHANNELS = [
    channel(1, "1", "MTData2", "Acceleration", "vector", [number_column(a, "f4", "m/s²", a, 3) for a in "xyz"]),
    channel(2, "1", "MTData2", "LatLon", "vector", [number_column(a, "f8", "°", "", 7) for a in ("lat", "lon")]),
    channel(3, "1", "MTData2", "PositionEcef", "vector", [number_column(a, "f8", "m", a) for a in "xyz"], frame="ECEF"),
    channel(4, "1", "MTData2", "VelocityXYZ", "vector", [number_column(a, "f4", "m/s", a) for a in "xyz"], frame="ENU"),
    channel(5, "1", "GNSS1", "Speed", "scalar", [number_column("value", "f4", "m/s")], group="GNSS 1"),
]
DEVICE = {
    "id": "1",
    "name": "MTi-680",
    "protocol": "xbus",
    "product": "MTi-680",
    "serial_number": "0080A1B2",
    "firmware": "1.12.0",
    "source": "/dev/ttyUSB0",
}
SNAPSHOT = {
    "protocol": "xbus",
    "product": "MTi-680",
    "values": {
        "LatLonAlt": {"latitude": LATITUDE, "longitude": LONGITUDE, "altitude": 31.5},
        "OptionFlags": {"flags": 0},
        "Remark": {"text": f"mast at {LATITUDE:.4f}"},
    },
}


def drive(folder: Path, n: int = 2000, rate: float = 100.0, **manifest: Any) -> ColumnStore:
    """N samples of an acceleration with one peak and one gap, and a position ten times a second."""
    rng = np.random.default_rng(7)
    writer = ColumnStoreWriter(folder)
    for info in CHANNELS:
        dtypes = tuple(one["dtype"] for one in info["columns"])
        writer.channel(info["id"], ChannelLayout(dtypes, (False,) * len(dtypes)))
    rows = np.arange(n) + 20 * (np.arange(n) >= n // 2)  # twenty are missing in the middle
    time = START + rows / rate
    acceleration = rng.normal(size=(3, n)).astype(np.float32)
    acceleration[2, n // 3] = 987.0  # one sample that no thinning may lose
    writer.append(1, [time, time, *acceleration])
    slow = time[::10]
    away = np.linspace(0, 1e-3, len(slow))
    writer.append(2, [slow, slow, LATITUDE + away, LONGITUDE + away])
    writer.append(3, [slow, slow, *(coordinate + 50 * away for coordinate in ECEF)])
    writer.append(4, [slow, slow, *(away.astype(np.float32) for _ in range(3))])
    writer.append(5, [slow, slow, away.astype(np.float32)])
    events = [
        {"seq": 1, "time": time[n // 2], "device": "1", "kind": "gap", "level": "error", "samples": 20}
        | {"text": "20 samples lost.", "t0": float(time[n // 2 - 1]), "t1": float(time[n // 2])},
        {"seq": 2, "time": START + 1, "device": "1", "kind": "device", "level": "info", "samples": 0}
        | {"text": f"Fix at {LATITUDE:.5f}, {LONGITUDE:.5f}.", "t0": None, "t1": None},
    ]
    details = {
        "channels": CHANNELS,
        "devices": [DEVICE],
        "started": START,
        "ended": float(time[-1]),
        "events": events,
        "markers": [{"time": START + 2, "kind": "marker", "text": "kerb", "device": ""}],
        "damage": [],
        "format": "mcap",
        "figures": {"1": {"bytes": 12345, "lost": 20, "gaps": 1, "rejects": 3, "messages": {"MTData2": n}}},
        "snapshots": {"1": SNAPSHOT},
    }
    return writer.finish({**details, **manifest})


def made(store: ColumnStore, out: Path, about: About | None = None, **request: Any) -> str:
    """The text of the file made with this request."""
    write(store, about or About("A drive"), EvidenceRequest(**request), out, lambda share: None)
    return out.read_text(encoding="utf-8")


def content_in(text: str) -> dict[str, Any]:
    """The JSON in a file."""
    match = re.search(r'<script type="application/json" id="content">(.*?)</script>', text, re.DOTALL)
    assert match is not None
    return dict(json.loads(match[1]))


def block_in(text: str, block: dict[str, Any]) -> NDArray[Any]:
    """A binary block of a file."""
    match = re.search(rf'<script type="text/plain" id="block-{block["block"]}">(.*?)</script>', text)
    assert match is not None
    return np.frombuffer(base64.b64decode(match[1]), f"<{block['type']}")


def series_in(text: str, plot: str, label: str) -> dict[str, Any]:
    """A series of the content by the title of its plot and its label."""
    plots = {one["title"]: one for one in content_in(text)["plots"]}
    return next(dict(one) for one in plots[plot]["series"] if one["label"] == label)
