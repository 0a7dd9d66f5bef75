"""Round trips: a file that is exported and opened again is the same, value by value, where the guide says so."""

import gzip
import lzma
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

import imuscope
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import FORMATS, ExportRequest, export
from imuscope.recordings.exporters.file_names import table_paths
from imuscope.recordings.exporters.formats.csv_plotjuggler import channel_topics
from imuscope.recordings.exporters.message_table import tables
from imuscope.recordings.exporters.request import ExportError
from imuscope.recordings.exporters.topics import fields_of, frame_of, schema_of
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.library.export_worker import one_file
from tests.recordings.readers.formats.bags import ros2_bag
from tests.recordings.recorded_drive import START, drive
from tests.recordings.store_fixtures import store
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row
from tests.support.server_process import ROOT

Info = Mapping[str, Any]
Key = tuple[str, str]

GUIDE = ROOT / "docs" / "guide" / "recordings.md"
HEAD = ("format", "signals", "values", "units", "frames", "time", "arrival", "device clocks", "segments")
HELD: Mapping[str, Sequence[str]] = {
    "csv": ("all", "all", "yes", "all but that of the body", "yes", "yes", "yes", "yes"),
    "parquet": ("all", "all", "yes", "yes", "yes", "yes", "yes", "yes"),
    "csv-plotjuggler": ("all but tables", "finite", "in the names", "no", "yes", "yes", "yes", "of one device"),
    "mcap": ("all", "finite", "yes; of angles °", "yes", "yes", "signals of their own", "yes", "yes"),
    "rosbag2-mcap": ("those of a message", "finite", "SI", "ROS", "yes", "yes", "in seconds", "yes"),
    "rosbag2-sqlite3": ("those of a message", "finite", "SI", "ROS", "yes", "yes", "in seconds", "yes"),
    "euroc": ("rate of turn, acceleration", "finite", "SI", "no", "yes", "no", "no", "yes"),
    "mtb": ("all", "all", "yes", "yes", "spacing", "no", "yes", "yes"),
    "raw": ("all", "all", "yes", "yes", "spacing", "no", "yes", "yes"),
    "bytes": ("all", "all", "yes", "yes", "spacing", "no", "yes", "yes"),
    "recording": ("all", "all", "yes", "yes", "within ±", "yes", "yes", "yes"),
}
NOT_OPENED = {"csv-aligned", "rrd"}
SOURCES = ("xbus", "isb", "idtp", "table", "messages")
GOLDEN_FILES = (
    *(f"golden/{name}" for name in ("isb/logs/log.raw.xz", "can/mti.log.gz", "blackbox/every_1.bbl")),
    *(f"golden/previous_formats/1/{name}.mcap" for name in ("xbus", "isb", "idtp")),
)
FIELD_FILES = (
    *("c01_mt_manager_export.txt", "c05_date_and_time.csv", "c06_decimal_comma.csv", "c12_clock_goes_back.csv"),
    *("c16_gnss.nmea", "c20_imu_without_orientation.mcap", "c22_stamp_is_uptime.mcap", "c27_ros1.bag"),
    *("c31_ros_covariance.raw", "c32_idtp_wrap.bin", "aim_racestudio_padded.csv", "gyroflow.gcsv"),
    *("movesense_packets.json", "nmea_rmc_cog_empty.nmea", "polar_phone_and_sensor_clock.txt"),
    *("recorded_nmea_has_utc.mcap", "tunerstudio.msl", "unit_row_one_unknown.csv"),
)
IN_FULL = ("csv", "parquet", "csv-plotjuggler", "mcap")
SIMULATED = ("xbus", "isb", "idtp")
BYTES = {"mtb": ("xbus",), "raw": ("isb",), "bytes": SIMULATED, "recording": SIMULATED}
DEG = np.pi / 180
SHOWN = {"rad/s": ("°/s", 1 / DEG), "mm": ("m", 1e-3)}  # units in which messages are shown
FRD = np.array([1.0, -1.0, -1.0])
ROS: Mapping[str, Mapping[str, tuple[str, Any]]] = {  # signal → name in a bag, and its axes or scale there
    "xbus": {
        "RateOfTurn": ("imu/data_raw.angular_velocity", 1),
        "Acceleration": ("imu/data_raw.linear_acceleration", 1),
        "Quaternion": ("imu/data.orientation", 1),
        "BaroPressure": ("pressure.fluid_pressure", 1),
        "Temperature": ("temperature.temperature", 1),
    },
    "isb": {
        "DID_IMU.I.pqr": ("imu/data_raw.angular_velocity", FRD),
        "DID_IMU.I.acc": ("imu/data_raw.linear_acceleration", FRD),
        "DID_INS_1.uvw": ("velocity.twist.linear", FRD),
    },
    "idtp": {
        "RateOfTurn": ("imu/data_raw.angular_velocity", 1),
        "MagneticField": ("imu/mag.magnetic_field", 1),
        "BaroPressure": ("pressure.fluid_pressure", 1),
        "Quaternion": ("imu/data.orientation", 1),
    },
    "messages": {
        "/imu/data.angular_velocity": ("data.angular_velocity", 1),
        "/imu/data.linear_acceleration": ("data.linear_acceleration", 1),
    },
}


@dataclass(frozen=True, slots=True)
class SignalColumn:
    """One column of a signal; rows that lack a number are left out."""

    values: NDArray[Any]
    time: NDArray[np.float64]
    arrival: NDArray[np.float64]
    unit: str
    frames: frozenset[str]


def source_of(name: str, folder: Path) -> Path:
    """The file of a source."""
    path = folder / f"{name}.mcap"
    if name == "xbus":
        drive(path)
    elif name == "messages":
        return ros2_bag(folder / "messages")
    elif name == "table":
        path = folder / "table.csv"
        steps = np.arange(400) / 100 - 2.0 * (np.arange(400) >= 250)
        rows = [f"{1.5e9 + t:.3f},{k / 7!r},{-k},{'inf' if k == 9 else ''},{k}.5" for k, t in enumerate(steps)]
        head = "time (s),gyr_x (rad/s),count,odd,vel.north (m/s; NED)"
        path.write_text("\n".join([head, *rows, ""]))
    else:
        device: Any = IsbSimulator() if name == "isb" else IdtpSimulator()
        writer = McapWriter(path, {"title": name})
        writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": name})
        for n in range(1, 300):
            if data := device.advance(n * 10_000_000):
                writer.chunk("1", "rx", data, START + n * 10_000_000)
        writer.close()
    return path


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, imuscope.Recording]:
    """All sources."""
    folder = tmp_path_factory.mktemp("sources")
    return {name: imuscope.open(source_of(name, folder)) for name in SOURCES}


def store_of(recording: imuscope.Recording) -> ColumnStore:
    return recording._store


def column(columns: ColumnStore, info: Info, at: int) -> SignalColumn:
    rows = columns.exact(info["id"], 0, columns.rows(info["id"]))
    values = rows.columns[at]
    there = ~np.isnan(values) if values.dtype.kind == "f" else np.ones(len(values), bool)
    time = np.where(np.isnan(rows.time), rows.arrival, rows.time)
    frames = frozenset({info["frame"], frame_of(info["columns"][at], info["frame"])})
    order = np.flatnonzero(there)[np.argsort(time[there], kind="stable")]  # as exports have them
    return SignalColumn(values[order], time[order], rows.arrival[order], info["columns"][at]["unit"], frames)


def plain(text: str) -> str:
    """A name whatever separates its words."""
    return re.sub(r"[._/]+", ".", text)


def expected(export_format: str, request: ExportRequest, out: Path) -> Iterator[tuple[Key, Info, int]]:
    """Message and name of each column in a format, and where it is from."""
    if export_format in ("csv", "parquet"):
        made = tables(request)
        for table, path in zip(made, table_paths(request, out, made), strict=True):
            for names, info in zip(table.names, [*table.clocks, *table.channels], strict=True):
                yield from (((path.stem, plain(name)), info, at) for at, name in enumerate(names))
        return
    topics = channel_topics(request)
    for info in (*request.clocks, *request.infos):
        topic = topics[info["id"]]
        if export_format == "mcap":
            places = list(schema_of({**info, "kind": ""})["properties"])
            yield from (((topic, str(places.index(field))), info, at) for at, field in enumerate(fields_of(info)))
        elif info["kind"] != "table":
            yield from ((("", plain(f"{topic}/{field}")), info, at) for at, field in enumerate(fields_of(info)))


def columns_of(export_format: str, columns: ColumnStore) -> Mapping[Key, SignalColumn]:
    """Message and name of each column that was read."""
    keys: dict[Key, SignalColumn] = {}
    for info in columns.manifest["channels"]:
        for at, one in enumerate(info["columns"]):
            name = plain(info["name"] if len(info["columns"]) == 1 else f"{info['name']}.{one['name']}")
            key = (info["message"], str(at) if export_format == "mcap" else name)
            keys.setdefault(("", name) if export_format == "csv-plotjuggler" else key, column(columns, info, at))
    return keys


def opened_again(export_format: str, recording: imuscope.Recording, folder: Path) -> imuscope.Recording:
    """The export, as it is downloaded, opened; an EuRoC folder as it is written."""
    made = export(
        export_format,
        ExportRequest(store_of(recording), recording.path),
        folder / f"run{FORMATS[export_format].suffix}",
    )
    if export_format == "euroc":
        return imuscope.open(made[0])
    protocol = recording.devices[0].protocol if export_format in BYTES else ""
    return imuscope.open(one_file(made, folder, "run"), protocol=protocol)


def assert_same(export_format: str, recording: imuscope.Recording, folder: Path) -> int:
    """Compare an export, opened again, with its source; how many columns had a number."""
    source = store_of(recording)
    units, frames, arrivals = HELD[export_format][2], HELD[export_format][3], HELD[export_format][5]
    with opened_again(export_format, recording, folder) as again:
        keys = columns_of(export_format, store_of(again))
        count = 0
        for key, info, at in expected(
            export_format, ExportRequest(source), folder / f"run{FORMATS[export_format].suffix}"
        ):
            target = column(source, info, at)
            if target.values.dtype == object:  # payloads, which are texts
                continue
            finite = (
                np.isfinite(target.values) if HELD[export_format][1] == "finite" else np.ones(len(target.values), bool)
            )
            if not finite.any():
                continue
            back = keys[key]
            if export_format == "mcap" and target.unit in SHOWN:
                unit, factor = SHOWN[target.unit]
                np.testing.assert_allclose(back.values, target.values[finite] * factor, rtol=1e-15)
                assert back.unit == unit
                continue
            np.testing.assert_array_equal(back.values.astype(target.values.dtype), target.values[finite], str(key))
            np.testing.assert_array_equal(back.time, target.time[finite], str(key))
            if arrivals == "yes":
                np.testing.assert_array_equal(back.arrival, target.arrival[finite], str(key))
            if units.startswith("yes"):
                assert back.unit == target.unit, key
            if frames != "no":
                assert back.frames & (target.frames | ({""} if "body" in target.frames else set())), key
            count += 1
        if HELD[export_format][7] in ("yes", "of one device"):
            begins = [[*chain(*one.manifest["segments"].values())] for one in (source, store_of(again))]
            assert begins[0] == begins[1]
        if export_format == "mcap":
            arrivals_of = [one for one in again.signals if one.message.endswith("/arrival")]
            every = np.concatenate([one.column("arrival" if len(one.columns) > 1 else 0) for one in arrivals_of])
            assert all(np.isin(one.arrival, every).all() for one in recording.signals)
            numbered = [one for one in arrivals_of if "segment" in one.columns]
            assert sum(one.column("segment").max() for one in numbered) == len(begins[0]) * (len(numbered) or 1)
    return count


@each_row("export_format", IN_FULL)
@each_row("name", SOURCES)
def test_what_is_opened_again_is_the_same(
    name: str, export_format: str, opened: Mapping[str, imuscope.Recording], tmp_path: Path
) -> None:
    assert assert_same(export_format, opened[name], tmp_path)
    assert len([*chain(*store_of(opened[name]).manifest["segments"].values())]) == (name == "table")


def file_of(name: str, folder: Path) -> Path:
    """A golden file, unpacked, or one of the field."""
    if not name.startswith("golden/"):
        return field_file(name)
    path = ROOT / "tests" / name
    if path.suffix != ".xz":
        return path
    unpacked = folder / path.stem
    unpacked.write_bytes(lzma.decompress(path.read_bytes()))
    return unpacked


@each_row("name", [*GOLDEN_FILES, *FIELD_FILES])
def test_a_file_that_is_exported_and_opened_again_is_the_same(name: str, tmp_path: Path) -> None:
    """Rows without a device time were left out."""
    with imuscope.open(file_of(name, tmp_path)) as source:
        for export_format in IN_FULL:
            (tmp_path / export_format).mkdir()
            assert assert_same(export_format, source, tmp_path / export_format), export_format


@each_row("name", [*GOLDEN_FILES, "golden/xbus/sample.mtb", *FIELD_FILES])
def test_no_export_has_a_second_column_of_one_name(name: str, tmp_path: Path) -> None:
    """Absence is a value: whether a field is there makes no column, and Euler angles were there twice."""
    with imuscope.open(file_of(name, tmp_path)) as source:
        request = ExportRequest(store_of(source), source.path)
        for one in FORMATS.values():
            (tmp_path / one.name).mkdir()
            with suppress(ExportError):  # nothing in it that the format can hold
                made = [] if one.name in BYTES else export(one.name, request, tmp_path / one.name / f"run{one.suffix}")
                files = [file for path in made for file in (path, *path.rglob("*")) if file.is_file()]
                for file in files:
                    text = pq.read_schema(file).to_string() if file.suffix == ".parquet" else _texts_of(file)
                    assert not re.search(r" #\d", text), file.name
        assert not [one.name for one in source.signals if " #" in one.name]


def _texts_of(file: Path) -> str:
    """The first lines of a text; of another file the names in it, which are not packed."""
    data = file.read_bytes()
    if file.suffix == ".csv":
        return b"".join(data.splitlines(keepends=True)[:2]).decode()
    return "\n".join(re.findall(r"[A-Za-z_.\]]{3,} #\d", data.decode("latin-1")))


@each_row("export_format", [name for name in FORMATS if name.startswith("rosbag2-")])
@each_row("name", sorted(ROS))
def test_what_a_message_of_ros_holds_is_the_same(
    name: str, export_format: str, opened: Mapping[str, imuscope.Recording], tmp_path: Path
) -> None:
    source = opened[name]
    with opened_again(export_format, source, tmp_path) as again:
        names = {one.name.removeprefix("/").partition("/")[2]: one for one in again.signals}
        for signal, (topic, scale) in ROS[name].items():
            target, back = source[signal], names[topic]
            np.testing.assert_array_equal(back.time, target.time)
            np.testing.assert_array_equal(back.arrival, target.arrival)
            assert back.units == target.units
            tolerance = 1e-6 if target.kind == "quaternion" else 2e-15  # it has unit length afterwards
            values, sent = back.in_units("SI").values, target.in_units("SI").values
            np.testing.assert_allclose(values, sent * scale, rtol=tolerance, atol=tolerance)


@each_row("name", [name for name in SOURCES if name != "table" and "euroc" in FORMATS])
def test_a_euroc_folder_is_the_same_in_si_units(
    name: str, opened: Mapping[str, imuscope.Recording], tmp_path: Path
) -> None:
    turn, acceleration = {
        "isb": ("DID_IMU.I.pqr", "DID_IMU.I.acc"),
        "messages": ("/imu/data.angular_velocity", "/imu/data.linear_acceleration"),
    }.get(name, ("RateOfTurn", "Acceleration"))
    with opened_again("euroc", opened[name], tmp_path) as again:
        for own, target, unit in (("w_RS_S", turn, "rad/s"), ("a_RS_S", acceleration, "m/s²")):
            back = again[own]
            np.testing.assert_array_equal(back.values, opened[name][target].values_in(unit))
            np.testing.assert_array_equal(back.time, opened[name][target].time)
        assert again["w_RS_S"].units == ("rad/s",) * 3


@each_row("export_format", [name for name in FORMATS if name.startswith("rosbag2-") or name == "euroc"])
def test_a_table_with_units_is_held_by_what_filters_read(export_format: str, tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    units = {"gyro_bias": "deg/s", "gyro": "deg/s", "user_acc": "m/s^2", "Accelerometer": "m/s^2"}
    numbers = {name: np.sin(np.arange(60).reshape(20, 3) + at) for at, name in enumerate(units)}
    times = 1.7e9 + np.arange(20) / 100 - 2.0 * (np.arange(20) >= 12)
    rows = np.column_stack([times, *numbers.values()])
    head = ["time (s)", *(f"{name}_{axis} ({unit})" for name, unit in units.items() for axis in "xyz")]
    path.write_text("\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())]))
    with imuscope.open(path) as source, opened_again(export_format, source, tmp_path) as again:
        turn, acceleration = (one for one in again.signals if one.columns == ("x", "y", "z"))
        scale = DEG if export_format == "euroc" else 1.0
        np.testing.assert_allclose(turn.values, numbers["gyro"] * scale, rtol=2e-15)
        np.testing.assert_array_equal(acceleration.values, numbers["Accelerometer"])
        np.testing.assert_array_equal(turn.time, source["gyro"].time)
        assert [len(part) for part in turn.segments()] == [12, 8]


@each_row("export_format", [name for name in FORMATS if name.startswith("rosbag2-") or name == "euroc"])
def test_segments_are_restored(export_format: str, tmp_path: Path) -> None:
    """A device that restarted: its sample time begins at 0 again, and nothing else says so in these files."""
    data = gzip.decompress((ROOT / "tests" / "golden" / "can" / "mti.log.gz").read_bytes())
    lines = data.splitlines(keepends=True)
    later = [b"(%d.%b" % (int(one[1:11]) + 5, one[12:]) for one in lines]
    numbers = [number for number, one in enumerate(later) if b" 005#" in one]
    for sample, number in enumerate(numbers):
        later[number] = b"%b 005#%08X\n" % (later[number].partition(b" 005#")[0], 100 * sample)
    path = tmp_path / "restarted.log"
    path.write_bytes(b"".join(lines + later))
    with imuscope.open(path) as source:
        [begin] = store_of(source).manifest["segments"]["1"]
        with opened_again(export_format, source, tmp_path) as again:
            assert store_of(again).manifest["segments"] == {"1": [pytest.approx(begin, abs=1e-6)]}


@each_row("pair", [(export_format, name) for export_format, names in BYTES.items() for name in names])
def test_bytes_are_decoded_again(
    pair: tuple[str, str], opened: Mapping[str, imuscope.Recording], tmp_path: Path
) -> None:
    export_format, name = pair
    with opened_again(export_format, opened[name], tmp_path) as again:
        signals = {(one.message, one.name): one for one in again.signals}
        for target in opened[name].signals:
            back = signals[target.message, target.name]
            assert (back.units, back.frame, back.columns) == (target.units, target.frame, target.columns)
            for at in range(len(target.columns)):
                np.testing.assert_array_equal(back.column(at), target.column(at))


@each_row("export_format", ["csv", "parquet"])
def test_satellites_of_one_time_are_opened_again(export_format: str, tmp_path: Path) -> None:
    """They were refused, as rows that all have the same time."""
    with imuscope.open(ROOT / "tests" / "golden" / "xbus" / "sample.mtb") as source:
        before = source["GnssSatInfo"]
        with opened_again(export_format, source, tmp_path) as again:
            back = next(one for one in again.signals if one.name.endswith("svId") or "svId" in one.columns)
            assert len(back) == len(before) == 40
            np.testing.assert_array_equal(back.time, before.time)


@each_row("export_format", ["csv", "parquet"])
def test_a_message_without_a_clock_has_its_arrival(export_format: str, tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    made = export(export_format, ExportRequest(columns, device="2"), tmp_path / f"run{FORMATS[export_format].suffix}")
    with imuscope.open(made[0]) as again:
        rows = columns.exact(5, 0, 500)
        np.testing.assert_array_equal(again["insStatus"].values, rows.columns[0])
        np.testing.assert_array_equal(again["insStatus"].time, rows.arrival)


def test_the_guide_states_which_format_holds_what() -> None:
    ours = set(FORMATS) - NOT_OPENED
    assert ours <= set(HELD)
    titles = {name: FORMATS[name].title if name in FORMATS else "" for name in HELD}
    lines = [f"| {' | '.join(HEAD)} |", f"|{'---|' * len(HEAD)}"]
    lines += [f"| {' | '.join((titles[name], *cells))} |" for name, cells in HELD.items() if name in FORMATS]
    text = GUIDE.read_text(encoding="utf-8")
    assert [line for line in lines if line not in text] == [], "\n".join(["docs/guide/recordings.md needs:", *lines])


@each_row("export_format", ["csv", "parquet"])
def test_a_quantity_that_is_sent_less_often_has_its_own_rows_again(
    export_format: str, opened: Mapping[str, imuscope.Recording], tmp_path: Path
) -> None:
    """Regression: it had those of the most frequent one, nearly all NaN, so its rate and length were others."""
    counts = {one.name: len(one) for one in opened["xbus"].signals}
    assert counts["Temperature"] < counts["BaroPressure"] < counts["Acceleration"]
    with opened_again(export_format, opened["xbus"], tmp_path) as again:
        assert {one.name: len(one) for one in again.signals} == counts
