"""HDF5 files written by h5py, and such as MATLAB 7.3 writes."""

from pathlib import Path

import h5py
import numpy as np

COUNT = 400
BEGIN = 1_500_000_000.0
TIME = BEGIN + np.arange(COUNT) / 100
GYRO = np.stack([np.sin(4 * np.pi * np.arange(COUNT) / 100), np.zeros(COUNT), np.ones(COUNT)], axis=1)
HEAD = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu Jan  1 00:00:00 2026 HDF5 schema 1.00 ."


def packed(path: Path) -> None:
    """Chunks, compressed, shuffled and with checksums, which do not divide the rows."""
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        options = {"chunks": (70, 2), "compression": "gzip", "shuffle": True, "fletcher32": True}
        file.create_dataset("imu/gyro", data=GYRO, maxshape=(None, 3), **options)
        file["imu/gyro"].attrs["units"] = "rad/s"
        file["label"] = "a"


def plain(path: Path) -> None:
    """Numbers that lie together, big-endian, with the samples side by side."""
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["imu/gyro"] = np.ascontiguousarray(GYRO.T).astype(">f8")
        file["imu/gyro"].attrs["units"] = np.bytes_("rad/s")


def compact(path: Path) -> None:
    with h5py.File(path, "w", libver=("earliest", "v108")) as file:
        file["imu/gyro"] = GYRO
        file["imu/gyro"].attrs["unit"] = "rad/s"
        layout = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        layout.set_layout(h5py.h5d.COMPACT)
        space = h5py.h5s.create_simple((COUNT,))
        h5py.h5d.create(file.id, b"time", h5py.h5t.IEEE_F64LE, space, layout).write(h5py.h5s.ALL, h5py.h5s.ALL, TIME)


def records(path: Path, **options: object) -> None:
    """Rows with named fields, as PyTables and structured arrays of NumPy store them."""
    rows = np.zeros(COUNT, [("time", "f8"), *((f"gyro_{axis}", "<f8") for axis in "xyz"), ("label", "S3")])
    rows["time"] = TIME
    for place, axis in enumerate("xyz"):
        rows[f"gyro_{axis}"] = GYRO[:, place]
    with h5py.File(path, "w") as file:
        file.create_dataset("imu", data=rows, **options)


def packed_records(path: Path) -> None:
    records(path, chunks=(70,), compression="gzip", shuffle=True)


def matlab(path: Path) -> None:
    """A structure, a text and a cell, as MATLAB 7.3 stores them: matrices turned, 512 bytes ahead."""
    with h5py.File(path, "w", userblock_size=512) as file:

        def variable(name: str, array: np.ndarray, kind: str, **others: object) -> None:
            file.create_dataset(name, data=array, chunks=array.shape, compression="gzip")
            for key, value in {"MATLAB_class": np.bytes_(kind), **others}.items():
                file[name].attrs[key] = value

        variable("imu/t", TIME.reshape(1, COUNT), "double")
        variable("imu/gyro", np.ascontiguousarray(GYRO.T), "double")
        file["imu"].attrs["MATLAB_class"] = np.bytes_("struct")
        variable("label", np.array([[97], [98]], np.uint16), "char", MATLAB_int_decode=np.int32(2))
        variable("none", np.array([0, 0], np.uint64), "double", MATLAB_empty=np.uint8(1))
        file["#refs#/a"] = np.zeros((1, COUNT))
        file["cell"] = np.array([[file["#refs#/a"].ref]], h5py.ref_dtype)
        file["cell"].attrs["MATLAB_class"] = np.bytes_("cell")
        file["table"] = np.zeros((1, 6), np.uint32)
        file["table"].attrs["MATLAB_class"] = np.bytes_("timetable")
        file["table"].attrs["MATLAB_object_decode"] = np.int32(3)
    data = path.read_bytes()
    path.write_bytes(HEAD.ljust(116).ljust(124, b"\0") + b"\0\2IM" + data[128:])
