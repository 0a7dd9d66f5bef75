"""`python -m tests.web.record_wire`: record the frames sent to a page, for the page's component tests.

    sim:xbus, sim:isb, sim:idtp ── a server ──> tests/golden/wire/page-NAME.json.gz ──> web/src/testing/recorded.ts
    other scenes ─┘

Each file holds the texts and the newest sample frames of a page that has just been opened. Those of the families have
the HTTP answers of Configure too, after the settings were read, with those but the forms that were others before; those
of the scenes (tests/web/wire_scenes.py) what the library answers, and of recordings that are opened all of their
samples. tests/web/test_record_wire.py says when it must be run again.
"""

from __future__ import annotations

import base64
import gzip
import json
import sys
import tempfile
import time
import urllib.request
from copy import deepcopy
from pathlib import Path
from typing import Any

from imuscope.server.wire import SUBPROTOCOL
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S, connect
from tests.web.wire_scenes import SCENES

FOLDER = ROOT / "tests" / "golden" / "wire"
FAMILIES = ("xbus", "isb", "idtp")
SHOWN = ("forms", "values", "snapshots", "corrections", "traffic?limit=200")
SNAPSHOTS = "GET /api/devices/1/snapshots"
SAMPLES = 40
"""Messages of samples that are kept."""
SAMPLES_OF = {"isb": 150}
"""Where that is too few for what is sent once a second."""


def path_of(name: str) -> Path:
    return FOLDER / f"page-{name}.json.gz"


def recorded(name: str) -> Any:
    """Recorded frames of a family or a scene."""
    return json.loads(gzip.decompress(path_of(name).read_bytes()))


def shown(server: ServerProcess) -> dict[str, Any]:
    """Requests that Configure makes when a device is opened."""
    results = {f"GET /api/devices/1/{what}": server.request("GET", f"/api/devices/1/{what}") for what in SHOWN}
    return {**results, "GET /api/build": server.request("GET", "/api/build")}


def received_from(server: ServerProcess, stored: int = SAMPLES) -> dict[str, Any]:
    """Frames sent to a newly opened page: the newest text of each kind, and samples."""
    texts: dict[str, Any] = {}
    samples: list[bytes] = []
    url = server.url.replace("http", "ws") + "/ws"
    with connect(url, subprotocols=[SUBPROTOCOL]) as socket:  # type: ignore[list-item]
        socket.send(json.dumps({"op": "subscribe", "history": 3, "channels": None}))
        until = time.monotonic() + 4
        while time.monotonic() < until:
            message = socket.recv(timeout=PATIENCE_S)
            if isinstance(message, bytes):
                samples.append(message)
                continue
            text = json.loads(message)
            before = texts.get(text["op"])
            if before and text["op"] in ("events", "channels", "traffic"):
                key = "entries" if text["op"] == "traffic" else text["op"]
                text[key] = before[key] + text[key]
            texts[text["op"]] = text
    return {"texts": list(texts.values()), "samples": [base64.b64encode(one).decode() for one in samples[-stored:]]}


def edited(values: dict[str, Any]) -> list[tuple[str, Any]]:
    """Edits of an MTi that tests make: the form's bytes, more than the line carries, and rates that fit."""
    outputs = values.get("OutputConfiguration")
    if outputs is None:
        return []

    def with_rate(rate: int, without: int = 0) -> Any:
        changed = deepcopy(outputs)
        changed["outputs"] = [one for one in changed["outputs"] if one["data_identifier"] & 0xFFF0 != without]
        for one in changed["outputs"]:
            if one["data_identifier"] == 0x4020:
                one["output_frequency"] = rate
        return changed

    pressure = 0x3010
    too_much = {"setting": "OutputConfiguration", "values": with_rate(400, pressure)}
    return [
        ("preview", {"setting": "OutputConfiguration", "values": with_rate(50)}),
        ("preview", {"setting": "OutputConfiguration", "values": with_rate(100, pressure)}),
        ("preview", too_much),
        ("fit-rates", {**too_much, "baud": None}),
        ("preview", {"setting": "OutputConfiguration", "values": outputs}),
        ("preview", {"setting": "PortConfig", "values": values["PortConfig"]}),
        ("preview", {"command": "SetSyncSettings", "values": {"settings": []}}),
        ("preview", {"command": "RestoreFactoryDef", "values": {}}),
    ]


def side(kind: str, snapshot: str = "") -> dict[str, str]:
    """One of two that are compared."""
    return {"side": kind, "snapshot": snapshot, "device": "", "text": ""}


def record(family: str) -> None:
    """Write one file."""
    with tempfile.TemporaryDirectory() as folder, ServerProcess(f"sim:{family}", data=Path(folder)) as server:
        while server.request("GET", "/api/devices")[0]["status"] != "live":
            time.sleep(0.1)
        time.sleep(3)  # the figures of a minute have started, and rare messages have arrived
        page = received_from(server, SAMPLES_OF.get(family, SAMPLES))
        unread = shown(server)
        read = dict(unread)
        if unread["GET /api/devices/1/forms"]["settings"]:
            server.request("POST", "/api/devices/1/read", {"settings": None, "reason": "", "confirmed": True})
            while not server.request("GET", "/api/devices/1/jobs")["done"]:
                time.sleep(0.1)
            read = shown(server)
            page["read"] = received_from(server)["texts"]
            with_first = {"left": side("device"), "right": side("snapshot", read[SNAPSHOTS][-1]["name"]), "take": {}}
            for route, body in [*edited(read["GET /api/devices/1/values"]["values"]), ("compare", with_first)]:
                place = f"POST /api/devices/1/{route}"
                read[f"{place} {json.dumps(body, sort_keys=True)}"] = server.request("POST", place[5:], body)
    before = {place: answer for place, answer in unread.items() if answer != read.get(place) and "forms" not in place}
    _write(family, {"family": family, **page, "unread": before, "answers": read})


def record_scene(name: str) -> None:
    """Write one file of a scene, once all is as it will be."""
    windows: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder, SCENES[name](Path(folder)) as server:
        time.sleep(3)
        page = received_from(server)
        answers = {"GET /api/build": server.request("GET", "/api/build")}
        if recordings := server.request("GET", "/api/recordings"):
            answers["GET /api/recordings"] = recordings
            if name == "library":
                answers |= library_answers(server, recordings[0]["id"])
        if name == "recordings":
            for info in recordings:
                answers |= recording_answers(server, info["id"])
                windows[info["id"]] = whole_window(server, answers[f"GET /api/recordings/{info['id']}"])
    _write(name, {"family": "", **page, "unread": {}, "answers": answers, **({"windows": windows} if windows else {})})


def recording_answers(server: ServerProcess, recording: str) -> dict[str, Any]:
    """Answers when a recording is opened and when a marker is added."""
    place = f"/api/recordings/{recording}"
    while "channels" not in (detail := server.request("GET", place)):  # it is decoded first
        time.sleep(0.1)
    t0, t1 = detail["t0"], detail["t1"]
    health = {
        f"GET {place}/health?device={device['id']}": server.request(
            "GET", f"{place}/health?device={device['id']}&t0={t0}&t1={t1}"
        )
        for device in detail["devices"]
    }
    channels = ",".join(str(one["id"]) for one in detail["channels"] if one["kind"] != "table")
    query = f"t0={t0}&t1={t1}&base=device&partial=true&channels={channels}"
    figures = {f"GET {place}/statistics": server.request("GET", f"{place}/statistics?{query}")}
    marker = {"text": "second look", "kind": "marker", "time": t0 + 1.5, "device": ""}
    added = server.request("POST", f"{place}/markers", marker)
    return {f"GET {place}": detail, **health, **figures, f"POST {place}/markers": added}


def whole_window(server: ServerProcess, detail: dict[str, Any]) -> str:
    """Every sample of a recording, as on the wire."""
    path = f"/api/recordings/{detail['info']['id']}/window?t0={detail['t0']}&t1={detail['t1']}&width=8000"
    with urllib.request.urlopen(server.url + path, timeout=PATIENCE_S) as answer:
        assert answer.headers["x-exact"] == "1"
        return base64.b64encode(answer.read()).decode()


def library_answers(server: ServerProcess, recording: str) -> dict[str, Any]:
    """Answers when a recording of the library is tagged, searched, deleted and restored."""
    place = f"/api/recordings/{recording}"
    steps: list[tuple[str, str, Any]] = [
        ("PATCH", place, {"tags": ["mast"]}),
        ("DELETE", place, None),
        ("POST", f"{place}/undelete", None),
    ]
    answers: dict[str, Any] = {}
    for method, path, body in steps:
        words = f" {json.dumps(body, sort_keys=True)}" if body else ""
        answers[f"{method} {path}{words}"] = server.request(method, path, body)
    return answers


def _write(name: str, whole: dict[str, Any]) -> None:
    data = json.dumps(whole, separators=(",", ":"), ensure_ascii=False).encode()
    path_of(name).write_bytes(gzip.compress(data, mtime=0))
    print(f"{path_of(name).relative_to(ROOT)}: {path_of(name).stat().st_size:,} B of {len(data):,}")


if __name__ == "__main__":
    for name in sys.argv[1:] or [*FAMILIES, *SCENES]:
        (record if name in FAMILIES else record_scene)(name)
