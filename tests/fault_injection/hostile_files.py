"""Files that are made to harm whoever opens them, one function each; they are small, and what they unpack to is not."""

import bz2
import gzip
import io
import json
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import zstandard

METADATA = "metadata.yaml"
BAG = "rosbag2_bagfile_information"
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
ZEROS = 1 << 27


def _zip(*entries: tuple[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return out.getvalue()


def _bag_of(metadata: str) -> bytes:
    return _zip((METADATA, metadata.encode()), ("a.db3", b"SQLite format 3\0"))


def _database(folder: Path, *statements: str) -> bytes:
    path = folder / "hostile.db3"
    with closing(sqlite3.connect(path)) as database:
        for one in statements:
            database.execute(one)
        database.commit()
    data = path.read_bytes()
    path.unlink()
    return data


TOPICS = "CREATE TABLE topics (id INTEGER, name TEXT, type TEXT, serialization_format TEXT)"
MESSAGES = "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)"


def _npy(shape: str, data: bytes = b"", kind: str = "<f8") -> bytes:
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + data


def _hdf5(folder: Path, shape: tuple[int, ...], *, is_written: bool) -> bytes:
    import h5py

    path = folder / "hostile.h5"
    with h5py.File(path, "w") as file:
        packed = {"chunks": tuple(min(one, 1 << 20) for one in shape), "compression": "gzip", "compression_opts": 9}
        made = file.create_dataset("imu", shape, "f8", **packed if all(shape) else {})
        if is_written:
            made[...] = 0.0
    data = path.read_bytes()
    path.unlink()
    return data


def _matlab() -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, {"imu": np.zeros((ZEROS // 64, 8))}, do_compression=True)
    return out.getvalue()


def _parquet(columns: int) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    out = io.BytesIO()
    pq.write_table(pa.table({f"c{n}": [1.0, 2.0] for n in range(columns)}), out)
    return out.getvalue()


def _arrow(depth: int) -> bytes:
    import pyarrow as pa

    kind = pa.float64()
    for _ in range(depth):
        kind = pa.struct([("a", kind)])
    out = io.BytesIO()
    with pa.ipc.new_file(out, pa.schema([("time", pa.float64()), ("deep", kind)])):
        pass
    return out.getvalue()


def _mcap(encoding: str, schema: bytes, name: str, claimed: int | None = None) -> bytes:
    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start()
    number = writer.register_schema(name, encoding, schema)
    channel = writer.register_channel("/imu", "cdr", number)
    for n in range(10):
        writer.add_message(channel, n * 1_000_000, bytes(64), n * 1_000_000)
    writer.finish()  # type: ignore[no-untyped-call]
    data = out.getvalue()
    if claimed is not None:  # the uncompressed size of the first chunk
        at = data.index(b"\x06", 8) + 9 + 16
        data = data[:at] + struct.pack("<Q", claimed) + data[at + 8 :]
    return data


def _ros1(compression: str, data: bytes, size: int) -> bytes:
    """A bag of one chunk."""

    def record(head: dict[str, bytes], body: bytes) -> bytes:
        fields = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in head.items())
        return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(body)) + body

    empty = {"op": b"\x03", "index_pos": bytes(8), "conn_count": bytes(4), "chunk_count": struct.pack("<I", 1)}
    chunk = {"op": b"\x05", "compression": compression.encode(), "size": struct.pack("<I", size)}
    return b"#ROSBAG V2.0\n" + record(empty, b" " * 4000) + record(chunk, data)


def _ulog() -> bytes:
    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    itself = message(b"F", b"imu:uint64_t timestamp;imu[1000] inner;") + message(b"A", b"\0\0\0imu")
    return b"ULog\x01\x12\x35\x01" + bytes(8) + itself + message(b"D", bytes(1000))


HOSTILE: dict[str, Callable[[Path], bytes]] = {
    "deep.zip": lambda _: _bag_of("[" * 200_000),
    "deep_block.zip": lambda _: _bag_of("".join(f"{' ' * n}a:\n" for n in range(3000))),
    "laughs.zip": lambda _: _bag_of(
        "a0: &a0 [x, x]\n"
        + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))
        + f"{BAG}: {{relative_file_paths: *a11}}\n"
    ),
    "view_topics.db3": lambda folder: _database(
        folder,
        f"CREATE VIEW topics AS {ENDLESS} SELECT i AS id, 'a' AS name, 'b' AS type, 'cdr' AS "
        "serialization_format FROM n",
        MESSAGES,
    ),
    "view_messages.db3": lambda folder: _database(
        folder,
        TOPICS,
        f"CREATE VIEW messages AS {ENDLESS} SELECT i AS rowid, 1 AS topic_id, i AS timestamp, x'00' AS data FROM n",
        "INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')",
    ),
    "generated.db3": lambda folder: _database(
        folder,
        TOPICS,
        "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(100000000)))",
        "INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')",
        "INSERT INTO messages (id, topic_id, timestamp) VALUES " + ", ".join(["(1, 1, 1)"] * 500),
    ),
    "trigger.db3": lambda folder: _database(
        folder,
        TOPICS,
        MESSAGES,
        f"CREATE TRIGGER t AFTER INSERT ON messages BEGIN INSERT INTO topics {ENDLESS} SELECT "
        "i, 'a', 'b', 'c' FROM n; END",
    ),
    "virtual.db3": lambda folder: _database(folder, TOPICS, "CREATE VIRTUAL TABLE messages USING fts5(topic_id, data)"),
    "zero.npy": lambda _: _npy("(99999999999999, 0)"),
    "large.npy": lambda _: _npy(f"({1 << 62}, 3)", bytes(1 << 10)),
    "flat.npy": lambda _: _npy(f"(3, {1 << 60}, 0)"),
    "bomb.npz": lambda _: _zip(("imu.npy", _npy(f"({ZEROS // 8},)", bytes(ZEROS)))),
    "claims.npz": lambda _: _zip(("imu.npy", _npy(f"({1 << 59},)", bytes(1 << 10)))),
    "bomb.csv.gz": lambda _: gzip.compress(b"time,x\n" + b"0,0\n" * (ZEROS // 4), 9),
    "bomb.csv.zst": lambda _: zstandard.compress(b"time,x\n" + b"0,0\n" * (ZEROS // 4)),
    "archive.zip.gz": lambda _: gzip.compress(_zip(("a.zip", _zip(("a.csv", b"time,x\n0,0\n"))))),
    "archives.zip": lambda _: _zip(("a.zip", _zip(("b.zip", _zip(("a.csv", b"time,x\n0,0\n")))))),
    "files.zip": lambda _: _zip(*((f"{n}.csv", b"time,x\n0,0\n1,1\n") for n in range(9000))),
    "bomb.bag": lambda _: _ros1("bz2", bz2.compress(bytes(ZEROS)), ZEROS),
    "claims.bag": lambda _: _ros1("lz4", b"\x04\x22\x4d\x18", (1 << 32) - 1),
    "wide.csv": lambda _: "\n".join(",".join(map(str, range(400_000))) for _ in range(3)).encode(),
    "long_line.csv": lambda _: b"time,x\n" + b"1" * (1 << 24),
    "keys.json": lambda _: json.dumps([{f"k{n}": n for n in range(200_000)}] * 2).encode(),
    "deep.json": lambda _: b"[" * 500_000,
    "years.csv": lambda _: b"time,x\n" + b"".join(b"9999-12-31T23:59:%02dZ,%d\n" % (n, n) for n in range(60)),
    "wide.parquet": lambda _: _parquet(10_000),
    "deep.arrow": lambda _: _arrow(60),
    "empty.h5": lambda folder: _hdf5(folder, (1 << 50, 0), is_written=False),
    "large.h5": lambda folder: _hdf5(folder, (1 << 50, 3), is_written=False),
    "bomb.h5": lambda folder: _hdf5(folder, (ZEROS // 8,), is_written=True),
    "bomb.mat": lambda _: _matlab(),
    "recursive.mcap": lambda _: _mcap("ros2msg", b"a/B b\n" + b"=" * 80 + b"\nMSG: a/B\na/B b\n", "a/B"),
    "proto.mcap": lambda _: _mcap("protobuf", b"\x0a\x7f" + bytes(200), "a.B"),
    "claims.mcap": lambda _: _mcap("ros2msg", b"float64 x\n", "a/B", claimed=1 << 62),
    "recursive.ulg": lambda _: _ulog(),
    "packed.bin.gz": lambda _: gzip.compress(bytes(ZEROS), 9),
}
"""Name of a file → its bytes, made in a folder."""
