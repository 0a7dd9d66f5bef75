"""An exported .mcap has the topics, schemas and messages of the live Foxglove server."""

from __future__ import annotations

import asyncio
import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from imuscope.recordings.exporters.topics import Encoder, bodies, stamps, tables
from imuscope.server.cli import main
from tests.recordings.store_fixtures import channel, column
from tests.server.extensions.foxglove.foxglove_client import attached, protobuf
from tests.support.each_row import each_row
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get

LATEST = {"/MTi-680G/position", "/MTi-680G/attitude", "/IMX-5/position", "/IMX-5/attitude"}
# The store works angles out of quaternions; the device's own clock is of no interest while it is live.
ONLY_RECORDED = ("/clock", "/utc", "/arrival", "/bytes", "/Euler_angles")

Topic = tuple[str, str, str, str]
Messages = dict[str, list[tuple[int, bytes]]]


def read(path: Path) -> tuple[dict[str, Topic], Messages]:
    """Topics as they are advertised over a WebSocket, and messages by topic."""
    subjects: dict[str, Topic] = {}
    results: Messages = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        for one in summary.channels.values():
            schema = summary.schemas[one.schema_id]
            text = base64.b64encode(schema.data) if schema.encoding == "protobuf" else schema.data
            subjects[one.topic] = (one.message_encoding, schema.name, schema.encoding, text.decode())
        for _, one, message in reader.iter_messages():
            results.setdefault(one.topic, []).append((message.log_time, message.data))
    return subjects, results


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Topic], Messages, Path]:
    """Live advertisements and messages of two devices during a recording, and the export of this recording."""
    data = tmp_path_factory.mktemp("data")
    sources = ("sim:xbus?product=MTi-680G", "sim:isb")
    with ServerProcess(*sources, data=data, arguments=("--foxglove", "0", "--record")) as server:

        async def listen() -> tuple[dict[str, Topic], Messages]:
            async with attached(server) as client:
                await client.until(*LATEST)
                expected = [*LATEST, "/MTi-680G/Acceleration", "/MTi-680G/Status", "/events"]
                await client.subscribe(*(topic for topic in expected if topic in client.channels))
                results: Messages = {}
                while min(len(results.get(topic, ())) for topic in LATEST) < 3:  # events are as many as there are
                    for topic, at, body in await client.messages(20):
                        results.setdefault(topic, []).append((round(at * 1e9), body))
                details = {
                    name: (one["encoding"], one["schemaName"], one["schemaEncoding"], one["schema"])
                    for name, one in client.channels.items()
                }
                return details, results

        live, received = asyncio.run(listen())
        get(server.url + "/healthz").raise_for_status()
    (recorded,) = (data / "recordings").glob("*.mcap")
    out = data / "out.mcap"
    assert main(["decode", str(recorded), "-o", str(out)]) == 0
    return live, received, out


def test_an_export_has_the_topics_and_schemas_of_the_live_server(both: tuple[dict[str, Topic], Messages, Path]) -> None:
    """A layout made live did not fit the exported file: other topics, other fields, no transforms, no places."""
    live, received, out = both
    report, result = read(out)
    assert {topic: report.get(topic) for topic in live} == live
    assert result.keys() >= LATEST
    parted = max(at for messages in received.values() for at, _ in messages)
    more = {topic for topic in report.keys() - live.keys() if result[topic][0][0] < parted - 1e9}
    assert {topic for topic in more if not topic.endswith(ONLY_RECORDED)} == set()


def test_an_export_has_the_messages_of_the_live_server(both: tuple[dict[str, Topic], Messages, Path]) -> None:
    _, received, out = both
    _, results = read(out)
    for topic, live in received.items():
        entries = [body for _, body in results[topic]]
        if topic in LATEST:
            shown = {numbers_of(topic, body) for body in entries}
            assert all(numbers_of(topic, body) in shown for _, body in live), topic
        elif topic != "/events":
            values = {tuple(np.float32(list(json.loads(body).values())).tolist()) for body in entries}
            assert all(tuple(np.float32(list(json.loads(body).values())).tolist()) in values for _, body in live)


def numbers_of(topic: str, body: bytes) -> tuple[bytes, ...]:
    """A well-known message without its time, which is mapped again when a recording is opened."""
    time = 1 if topic.endswith("attitude") else 6
    return tuple(value for key, value in protobuf(body).items() if key != time)


def info_of(kind: str = "record") -> dict[str, Any]:
    bits = [{"name": "Clipped", "low": 3, "width": 1, "doc": "too much"}, {"name": "Mode", "low": 0, "width": 2}]
    columns = [{**column("value", "u4"), "bits": bits}, column("x", "f4", "m"), column("y", "f8"), column("n", "i8")]
    return channel(1, "1", "M", 'A "name"', kind, columns)


@each_row("kind", ["record", "table"])
def test_many_messages_at_once_are_what_they_are_one_by_one(kind: str) -> None:
    rng = np.random.default_rng(1)
    n = 300
    own = [
        rng.integers(0, 16, n).astype("u4"),
        rng.normal(size=n).astype("f4"),
        np.where(rng.random(n) < 0.2, np.nan, 10.0 ** rng.integers(-300, 300, n)),
        rng.integers(-(2**62), 2**62, n),
    ]
    own[1][7], own[2][8] = np.inf, -0.0
    time = np.repeat(np.arange(n / 3) + 1.7e9, 3)
    info = info_of(kind)
    expected = [(at, json.loads(body)) for at, body in Encoder(info).messages([time, time, *own])]
    at, many = stamps(time, time), bodies(info, own)
    if kind == "table":
        first = np.arange(0, n, 3)
        at, many = at[first], tables(many, first)
    results = [(when, json.loads(body)) for when, body in zip(at.tolist(), many.to_pylist(), strict=True)]
    assert [when for when, _ in results] == [when for when, _ in expected]
    assert [plain(body) for _, body in results] == [plain(body) for _, body in expected]


def test_a_message_without_a_single_number_is_still_one() -> None:
    info = channel(1, "1", "M", "Q", "scalar", [column("value", "f8")])
    assert bodies(info, [np.array([np.nan, 1.5, np.inf])]).to_pylist() == ["{}", '{"value":1.5}', "{}"]


def plain(body: Any) -> Any:
    """Single precision has more than one decimal that is right."""
    if isinstance(body, dict):
        return {name: np.float32(value) if name == "x_m" else plain(value) for name, value in body.items()}
    return [plain(one) for one in body] if isinstance(body, list) else body
