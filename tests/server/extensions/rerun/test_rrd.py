"""An `.rrd` file, read with Rerun's own reader, has the data of the columns under meaningful names and times."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.exporters import ExportRequest, by_suffix, export
from imuscope.recordings.exporters.entities import devices_of
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode import protocol_set
from imuscope.server.extensions.rerun.rrd.chunks import name_of
from imuscope.server.extensions.rerun.rrd.size_limit import MAX_ROWS, MAX_WHOLE_ROWS, limit_for
from imuscope.server.extensions.rerun.rrd.writer import Work, fill, stream_of, write_rrd
from imuscope.server.library.decode import decode
from tests.server.extensions.rerun.rrd_tables import column, entities, flat, numbers
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S

START = 1_760_000_000_000_000_000
ENVIRONMENT = {**os.environ, "HOME": os.devnull}  # Rerun's program would keep settings there


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> ColumnStore:
    """Six seconds of a device of each family on one clock, and a marker."""
    folder = tmp_path_factory.mktemp("rrd")
    devices = {
        "1": XbusSimulator(product="MTi-680G", start_ns=0),
        "2": IsbSimulator(start_ns=0),
        "3": IdtpSimulator(start_ns=0),
    }
    writer = McapWriter(folder / "a.mcap", {"title": "Three on a drive"})
    for device_id, protocol in zip(devices, ("xbus", "isb", "idtp"), strict=True):
        writer.device(device_id, {"source": f"sim:{protocol}", "link": "simulator", "protocol": protocol})
    for n in range(1, 600):
        for device_id, device in devices.items():
            if data := device.advance(n * 10_000_000):
                writer.chunk(device_id, "rx", data, START + n * 10_000_000)
    writer.write_note("marker", "bump", START + 2_000_000_000)
    writer.close()
    return decode(McapSource(folder / "a.mcap"), folder / "store", protocol_set.all_protocols())


@pytest.fixture(scope="module")
def read(store: ColumnStore, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[pa.RecordBatch]]:
    out = tmp_path_factory.mktemp("file") / "a.rrd"
    shares: list[float] = []
    write_rrd(store, out, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert [file.name for file in out.parent.iterdir()] == ["a.rrd"]
    return entities(out)


def times(batches: list[pa.RecordBatch], name: str, having: str) -> np.ndarray[Any, Any]:
    parts = [batch.column(name).cast(pa.int64()) for batch in batches if having in batch.schema.names]
    return np.concatenate([np.asarray(part) for part in parts])


def test_every_value_and_every_time_of_every_channel_is_in_the_file(
    store: ColumnStore, read: dict[str, list[pa.RecordBatch]]
) -> None:
    infos = {info["id"]: info for info in store.manifest["channels"]}
    compared = 0
    for device in devices_of(store.manifest["devices"], list(infos.values())):
        for number, curves in device.curves.items():
            rows = store.exact(number, 0, store.rows(number))
            for curve in curves:
                batches = read[name_of(curve.path)]
                expected = np.column_stack([rows.columns[i].astype(np.float64) for i in curve.columns])
                compared += expected.size
                if infos[number]["kind"] == "table":
                    np.testing.assert_array_equal(flat(batches), expected)
                    continue
                sample = times(batches, "sample", "Scalars:scalars")
                order = np.argsort(sample)  # rows stand in the order of their time
                np.testing.assert_array_equal(sample[order], np.arange(len(rows)))
                np.testing.assert_array_equal(numbers(batches, "Scalars:scalars")[order], expected)
                device_time = np.where(rows.time_ns == NO_TIME, rows.arrival_ns, rows.time_ns)
                for name, clock in (("device_time", device_time), ("arrival_time", rows.arrival_ns)):
                    np.testing.assert_array_equal(times(batches, name, "Scalars:scalars")[order], clock)
    assert compared == sum(store.rows(n) * len(infos[n]["columns"]) for n in infos) > 40_000


def test_an_entity_is_named_by_device_quantity_and_unit(read: dict[str, list[pa.RecordBatch]]) -> None:
    for path in (
        ("MTi-680G", "Acceleration [m/s²]"),
        ("IMX-5", "IMU Rate of turn [°/s]"),
        ("IMX-5", "INS 1 Position", "lat [°]"),
    ):
        assert name_of(path) in read, sorted(read)
    style = numbers_or_words(read[name_of(("MTi-680G", "Acceleration [m/s²]"))], "SeriesLines:names")
    assert style == ["x", "y", "z"]


def test_an_entity_has_the_frame_of_its_values(read: dict[str, list[pa.RecordBatch]]) -> None:
    frames = {
        str(path): [
            text
            for batch in batches
            for name in batch.schema.names
            if name.endswith("frame")
            for value in batch.column(name).to_pylist()
            for text in value or ()
        ]
        for path, batches in read.items()
    }
    assert any("Acceleration" in path and report == ["body"] for path, report in frames.items())
    assert any(report in (["NED"], ["ENU"], ["ENU from body"], ["NED from body"]) for report in frames.values())


def numbers_or_words(batches: list[pa.RecordBatch], name: str) -> list[Any]:
    return [word for lists in column(batches, name) for row in lists.to_pylist() for word in row]


def test_the_attitude_is_a_transform_of_the_body_in_its_own_frame(
    store: ColumnStore, read: dict[str, list[pa.RecordBatch]]
) -> None:
    quaternion = next(info["id"] for info in store.manifest["channels"] if info["name"] == "DID_INS_2.qn2b")
    rows = store.exact(quaternion, 0, store.rows(quaternion))
    body = read[name_of(("world", "IMX-5", "NED", "body"))]
    expected = np.column_stack([rows.columns[i] for i in (1, 2, 3, 0)])  # x, y, z, w
    np.testing.assert_array_equal(numbers(body, "Transform3D:quaternion"), expected)
    for part in ("shape", "axes"):
        assert name_of(("world", "IMX-5", "NED", "body", part)) in read
    # The frame is turned into the world's: north of NED is the world's y, down is its −z.
    turn = numbers(read[name_of(("world", "IMX-5", "NED"))], "Transform3D:quaternion")[0]
    np.testing.assert_allclose(turned(turn, (1, 0, 0)), (0, 1, 0), atol=1e-6)
    np.testing.assert_allclose(turned(turn, (0, 0, 1)), (0, 0, -1), atol=1e-6)


def turned(xyzw: Any, vector: Any) -> Any:
    """A vector, turned by a quaternion: v + 2 w (u × v) + 2 u × (u × v)."""
    u, w = np.asarray(xyzw[:3]), xyzw[3]
    return np.asarray(vector) + 2 * w * np.cross(u, vector) + 2 * np.cross(u, np.cross(u, vector))


def test_all_devices_stand_on_one_plane_in_metres(read: dict[str, list[pa.RecordBatch]]) -> None:
    places = [numbers(read[name_of(("world", name))], "Transform3D:translation") for name in ("MTi-680G", "IMX-5")]
    for enu in places:
        assert len(enu) > 50
        assert np.abs(enu).max() < 2000  # both drive the same believable way, and begin where the plane touches
    for name in ("MTi-680G", "IMX-5"):
        assert column(read[name_of(("world", "track", name))], "LineStrips3D:strips")


def test_a_device_is_at_its_reported_position_on_a_map(
    store: ColumnStore, read: dict[str, list[pa.RecordBatch]]
) -> None:
    infos = store.manifest["channels"]
    mapped = {device.name: device.position for device in devices_of(store.manifest["devices"], infos)}
    assert len(mapped) == 3
    for position in mapped.values():
        if position is None or not position.on_map:
            continue
        rows = store.exact(position.channel, 0, store.rows(position.channel))
        expected = np.column_stack([rows.columns[i].astype(np.float64) for i in position.columns[:2]])
        got = numbers(read[name_of(position.on_map)], "GeoPoints:positions")
        np.testing.assert_array_equal(got, expected[(expected != 0).any(axis=1)])
        [way] = column(read[name_of((*position.on_map, "track"))], "GeoLineStrings:line_strings")
        np.testing.assert_allclose(np.asarray(way.values.values.values).reshape(-1, 2)[0], got[0])
    assert sum(position is not None and bool(position.on_map) for position in mapped.values()) == 2


def test_the_map_is_behind_the_track_so_that_no_tiles_are_requested(store: ColumnStore) -> None:
    import rerun.blueprint as rrb

    from imuscope.server.extensions.rerun.rrd.blueprint import blueprint

    infos = store.manifest["channels"]
    root = blueprint(devices_of(store.manifest["devices"], infos), infos, []).root_container
    results: list[rrb.Tabs] = []
    waiting: list[object] = [root]
    while waiting:
        part = waiting.pop()
        if isinstance(part, rrb.Tabs) and any(isinstance(view, rrb.MapView) for view in part.contents):
            results.append(part)
        waiting += getattr(part, "contents", []) if isinstance(part, rrb.Container) else []
    [tabs] = results
    assert isinstance(tabs.contents[0], rrb.Spatial3DView)
    assert tabs.active_tab == 0


def test_live_plots_stand_in_two_columns_because_the_viewer_is_low_in_the_page(store: ColumnStore) -> None:
    import rerun.blueprint as rrb

    from imuscope.server.extensions.rerun.rrd.blueprint import blueprint

    infos = store.manifest["channels"]
    devices = devices_of(store.manifest["devices"], infos)
    root: Any = blueprint(devices, infos, ["/events/1"], live_s=20.0).root_container
    [row] = root.contents  # no row of texts below
    tabs = row.contents[-1]
    *plots, log = tabs.contents
    assert isinstance(log, rrb.TextLogView)
    assert all(isinstance(one, rrb.Grid) and one.grid_columns == 2 for one in plots)
    still: Any = blueprint(devices, infos, ["/events/1"]).root_container
    assert isinstance(still.contents[-1], rrb.TextLogView)


def test_curves_of_one_message_with_units_of_their_own_have_colours_of_their_own() -> None:
    import rerun as rr

    from imuscope.recordings.exporters.entities import Curve
    from imuscope.server.extensions.rerun.rrd.static import send_style

    columns = [{"name": name, "label": "", "axis": ""} for name in ("lat", "lon", "alt")]
    stream = rr.RecordingStream("imuscope")
    logged: list[Any] = []
    stream.log = lambda name, what, static: logged.append(what)  # type: ignore[method-assign, misc, assignment]
    for i in range(3):
        send_style(stream, Curve(("device", columns[i]["name"]), (i,)), columns, "")
    colors = [one.colors.as_arrow_array().to_pylist()[0] for one in logged]
    assert len(set(colors)) == 3


def test_changes_and_markers_are_written_as_text(read: dict[str, list[pa.RecordBatch]]) -> None:
    messages = [word for name, batches in read.items() if "changes" in name for word in texts(batches)]
    assert any("set" in word for word in messages)
    assert texts(read["/markers"]) == ["bump"]
    assert times(read["/markers"], "arrival_time", "TextLog:text").tolist() == [START + 2_000_000_000]
    assert any(name.startswith("/events/") for name in read)


def texts(batches: list[pa.RecordBatch]) -> list[str]:
    return numbers_or_words(batches, "TextLog:text")


def test_static_things_come_first_and_a_layout_is_in_it(store: ColumnStore, tmp_path: Path) -> None:
    write_rrd(store, tmp_path / "a.rrd")
    reader = RrdReader(tmp_path / "a.rrd")
    assert len(reader.blueprints()) == 1
    command = [sys.executable, "-m", "rerun_cli", "rrd", "print", str(tmp_path / "a.rrd")]
    process = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S, env=ENVIRONMENT)
    names = re.findall(r"\) - (/.*) - data columns", process.stdout)  # in the order of the file
    static = {chunk.entity_path for chunk in reader.stream() if chunk.is_static}
    begins = next(i for i, name in enumerate(names) if name.startswith(("/events", "/markers")))
    drawn = [name for name in static if name.startswith("/world/")]
    assert len(drawn) > 10
    assert static - set(names[:begins]) == set()


def drive(folder: Path, n: int) -> ColumnStore:
    """A store of one status word that flickers once, and a rotation of n samples at 1 kHz."""
    writer = ColumnStoreWriter(folder)
    writer.channel(1, ChannelLayout(("f4",) * 4, (False,) * 4))
    writer.channel(2, ChannelLayout(("u2",), (True,)))
    arrival = START / 1e9 + np.arange(n) / 1000
    angle = np.arange(n) / n * 3
    zero = np.zeros(n, np.float32)
    writer.append(
        1, [arrival, arrival, np.cos(angle / 2).astype(np.float32), zero, zero, np.sin(angle / 2).astype("f4")]
    )
    word = np.zeros(n, np.uint16)
    word[n // 2] = 4
    writer.append(2, [arrival, np.full(n, np.nan), word])
    bits = {"name": "Clipping", "low": 2, "width": 1, "choices": {}, "severity": "error", "normal_set": False}
    plain = {"unit": "", "label": "", "axis": "", "bits": []}
    info = {"device": "1", "message": "M", "group": "", "frame": "ENU from body", "unit": ""}
    turn = [{**plain, "name": name} for name in "wxyz"]
    word_column = {**plain, "name": "value", "bits": [bits]}
    channels = [
        {**info, "id": 1, "name": "Q", "title": "Quaternion", "kind": "quaternion", "columns": turn},
        {**info, "id": 2, "name": "S", "title": "Status", "kind": "status", "columns": [word_column]},
    ]
    devices = [{"id": "1", "name": "Sensor"}]
    return writer.finish({"devices": devices, "channels": channels, "events": [], "markers": []})


def test_a_range_is_the_samples_within_it_with_their_numbers(tmp_path: Path) -> None:
    store = drive(tmp_path / "store", 5000)
    t0 = START / 1e9 + 1
    write_rrd(store, tmp_path / "a.rrd", t0=t0, t1=t0 + 0.5, channels=[1])
    read = entities(tmp_path / "a.rrd")
    curve = read[name_of(("Sensor", "Quaternion"))]
    assert times(curve, "sample", "Scalars:scalars").tolist() == list(range(1000, 1501))
    assert not any("Status" in name for name in read)


def test_chunks_are_large(tmp_path: Path) -> None:
    store = drive(tmp_path / "store", 150_000)
    write_rrd(store, tmp_path / "a.rrd")
    chunks = [chunk for chunk in RrdReader(tmp_path / "a.rrd").stream() if not chunk.is_static]
    rows = [chunk.num_rows for chunk in chunks if "changes" not in chunk.entity_path]
    assert sum(rows) == 3 * 150_000
    assert sorted(rows)[len(rows) // 3] >= 10_000


def test_a_fault_of_one_sample_survives_thinning_and_is_reported(tmp_path: Path) -> None:
    store = drive(tmp_path / "store", 50_000)
    stream = stream_of("thin")
    fill(stream, Work(store, most=1000), "thin", lambda layout: stream.save(tmp_path / "a.rrd", layout))
    stream.flush()
    stream.disconnect()
    read = entities(tmp_path / "a.rrd")
    status = numbers(read["/Sensor/Status"], "Scalars:scalars")
    assert len(status) <= 1000
    assert status.max() == 4
    assert texts(read["/Sensor/Status/changes"]) == ["Clipping set", "Clipping cleared"]
    assert times(read["/Sensor/Status/changes"], "sample", "TextLog:text").tolist() == [25_000, 25_001]
    body = numbers(read["/world/Sensor/ENU/body"], "Transform3D:quaternion")
    assert len(body) <= 1000
    np.testing.assert_allclose((body**2).sum(axis=1), 1, atol=1e-6)  # samples, not least and greatest components
    assert "/thinned" in read


@each_row(
    ("counts", "as_much", "shown"),
    [
        ([], False, (0, 0, 1)),
        ([MAX_WHOLE_ROWS // 2, MAX_WHOLE_ROWS // 2], False, (MAX_WHOLE_ROWS, 0, 1)),
        ([3_600_000] * 7 + [100], False, (140_100, 20_000, 180)),
        ([3_600_000] * 7 + [100], True, (3_999_998, 571_414, 7)),
        ([MAX_WHOLE_ROWS + 1], True, (MAX_WHOLE_ROWS + 1, 0, 1)),
        ([MAX_ROWS + 1], True, (MAX_ROWS, MAX_ROWS, 2)),
        ([MAX_WHOLE_ROWS // 100] * 150, False, (MAX_WHOLE_ROWS - 100, 6666, 2)),
    ],
)
def test_a_browser_gets_no_more_than_it_holds(counts: list[int], as_much: bool, shown: tuple[int, int, int]) -> None:
    result = limit_for(counts, as_much)
    assert (result.rows, result.shown, result.most, result.every) == (sum(counts), *shown)


def test_a_stopped_export_leaves_no_files(tmp_path: Path) -> None:
    store = drive(tmp_path / "store", 5000)
    out = tmp_path / "out"
    out.mkdir()

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_rrd(store, out / "a.rrd", progress=stop)
    assert list(out.iterdir()) == []


def test_rerun_is_a_format_and_is_imported_on_demand_only(store: ColumnStore, tmp_path: Path) -> None:
    infos = store.manifest["channels"]
    acceleration = next(info["id"] for info in infos if info["name"] == "Acceleration" and info["device"] == "1")
    files = export(by_suffix(".rrd") or "", ExportRequest(store, channels=(acceleration,)), tmp_path / "a.rrd")
    assert [file.name for file in files] == ["a.rrd"]
    curves = {name for name, batches in entities(files[0]).items() if column(batches, "Scalars:scalars")}
    assert curves == {name_of(("MTi-680G", "Acceleration [m/s²]"))}
    code = "import sys; import imuscope.recordings.exporters; print('rerun' in sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    assert process.stdout.strip() == "False"


def test_a_layout_is_known_without_rerun() -> None:
    own = "imuscope.server.extensions.rerun.rrd.size_limit"
    names = f"imuscope.recordings.exporters.entities, imuscope.recordings.exporters.enu, {own}"
    code = f"import sys; import {names}; print('rerun' in sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    assert process.stdout.strip() == "False"


@each_row("name", ["drive.mcap", "yard (2), left/right", "Straße 7.", "…", ""])
def test_an_application_has_a_name_that_rerun_takes(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """A dot in it made Rerun print a warning with each export, and gave the application another name."""
    stream = stream_of(name)
    stream.disconnect()
    assert "migrat" not in capfd.readouterr().err
