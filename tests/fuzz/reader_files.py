"""A whole file for each reader of foreign formats (recordings/readers/formats/), from which damaged ones are made."""

import gzip
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import zstandard

from tests.recordings.readers.formats import bags, binary_tables, flight_logs, hdf5_files, witmotion_frames

GOLDEN = Path(__file__).resolve().parents[1] / "golden"
TABLE = "time (s),gyro.x (rad/s)\n" + "".join(f"{n / 100},{n % 7}\n" for n in range(200))


def _written(write: Callable[[Path], object]) -> Callable[[Path], bytes]:
    def data(folder: Path) -> bytes:
        path = folder / "written"
        made = write(path)
        [path] = [one for one in folder.rglob("written*") if one.is_file()]
        assert made is None or made == path
        return path.read_bytes()

    return data


def _ros2(folder: Path) -> bytes:
    [path] = bags.ros2_bag(folder / "bag").glob("*.db3")
    return path.read_bytes()


def _zip(folder: Path) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", TABLE)
        archive.writestr("b.csv", TABLE)
    return out.getvalue()


WHOLE: dict[str, tuple[str, Callable[[Path], bytes]]] = {
    "ros1": ("a.bag", _written(bags.ros1_bag)),
    "ros2": ("a.db3", _ros2),
    "ulog": ("a.ulg", lambda _: flight_logs.ulog()),
    "dataflash": ("a.bin", lambda _: flight_logs.dataflash()),
    "parquet": ("a.parquet", _written(binary_tables.parquet)),
    "arrow": ("a.arrow", _written(binary_tables.arrow)),
    "arrows": ("a.arrows", _written(binary_tables.arrow_stream)),
    "npz": ("a.npz", _written(binary_tables.npz)),
    "npy": ("a.npy", _written(binary_tables.npy)),
    "mat": ("a.mat", _written(binary_tables.mat)),
    "hdf5": ("a.h5", _written(hdf5_files.packed)),
    "mat73": ("a.mat", _written(hdf5_files.matlab)),
    "zip": ("a.zip", _zip),
    "gzip": ("a.csv.gz", lambda _: gzip.compress(TABLE.encode())),
    "zstd": ("a.csv.zst", lambda _: zstandard.compress(TABLE.encode())),
    "utf16": ("a.csv", lambda _: TABLE.encode("utf-16")),
    "lines": ("a.jsonl", lambda _: "".join(f"{json.dumps({'t': n / 100, 'x': n})}\n" for n in range(99)).encode()),
    "can": ("a.asc", lambda _: gzip.decompress((GOLDEN / "can" / "mti.asc.gz").read_bytes())[:9000]),
    "witmotion": ("a.bin", lambda _: b"".join(witmotion_frames.cycle(n, clock=True) for n in range(40))),
}
"""Kind → name of the file, and what makes it in an empty folder."""


def whole_files(folder: Path) -> dict[str, bytes]:
    """A whole file of each kind."""
    made = {}
    for kind, (_, make) in WHOLE.items():
        place = folder / kind
        place.mkdir()
        made[kind] = make(place)
    return made
