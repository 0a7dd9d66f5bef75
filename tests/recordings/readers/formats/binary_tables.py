"""Tables in Parquet, Arrow, NumPy and MATLAB files, written by their libraries."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq
from scipy.io import savemat

COUNT = 400
BEGIN = 1_500_000_000.0
NS = 1_500_000_000_000_000_000 + np.arange(COUNT) * 10_000_000
GYRO = np.stack([np.sin(4 * np.pi * np.arange(COUNT) / 100), np.zeros(COUNT), np.ones(COUNT)], axis=1)


def arrow_table() -> pa.Table:
    units = {b"unit": b"rad/s"}
    fields = [
        pa.field("time", pa.timestamp("us", "UTC")),
        *(pa.field(f"gyro.{axis}", pa.float64(), metadata=units) for axis in "xyz"),
        pa.field("flags", pa.list_(pa.int8())),
        pa.field("n", pa.int16()),
        pa.field("ok", pa.bool_()),
    ]
    columns = [
        pa.array(NS // 1000, pa.timestamp("us", "UTC")),
        *(pa.array(GYRO[:, k]) for k in range(3)),
        pa.array([[1]] * COUNT, pa.list_(pa.int8())),
        pa.array(np.arange(COUNT), pa.int16()),
        pa.array(np.arange(COUNT) % 2 == 0),
    ]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def parquet(path: Path) -> None:
    pq.write_table(arrow_table(), path, compression="zstd", row_group_size=150)


def arrow(path: Path) -> None:
    feather.write_feather(arrow_table(), path, compression="lz4", chunksize=150)


def arrow_stream(path: Path) -> None:
    with pa.ipc.new_stream(path, arrow_table().schema) as writer:
        writer.write_table(arrow_table(), 150)


def npz(path: Path) -> None:
    np.savez_compressed(path, time_ns=NS, gyro=GYRO, matrix=np.eye(4), label=np.array("a"))


def npy(path: Path) -> None:
    kind = np.dtype([("time", "i8"), ("gyro", "<f8", (3,))])
    array = np.zeros(COUNT, kind)
    array["time"], array["gyro"] = NS, GYRO
    np.save(path, array)


def mat(path: Path) -> None:
    savemat(path, {"imu": {"t_ns": NS.astype(np.float64), "gyro": GYRO}, "name": "a"}, do_compression=True)
