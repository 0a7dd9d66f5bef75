"""Packets of an OXTS receiver in a folder, as KITTI raw data have them, and in a zip."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.server.commands.common import readable
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

N = 40
START = 1_500_000_000  # 2017-07-14 02:40:00


def drive(folder: Path) -> Path:
    """A drive of N packets, 0.1 s apart, of which one has no file."""
    data = folder / "oxts" / "data"
    data.mkdir(parents=True)
    (folder / "oxts" / "dataformat.txt").write_text("lat: latitude of the oxts-unit (deg)\n")
    times = [f"2017-07-14 02:40:0{n // 10}.{n % 10}00000332\n" for n in range(N)]
    (folder / "oxts" / "timestamps.txt").write_text("".join(times))
    for n in range(N):
        if n != 7:
            (data / f"{n:010}.txt").write_text(
                " ".join(["48.1", "11.5", *map(str, range(2, 17)), f"{n % 5}"] + ["0"] * 12)
            )
    return folder


@each_row("kind", ["drive", "oxts", "zip"])
def test_packets_are_rows_with_their_times(kind: str, tmp_path: Path) -> None:
    path = drive(tmp_path / "drive")
    if kind == "oxts":
        path = path / "oxts"
    if kind == "zip":
        path = tmp_path / "drive.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for file in sorted((tmp_path / "drive").rglob("*.txt")):
                archive.write(file, f"2017_07_14/{file.relative_to(tmp_path)}")
            archive.writestr("2017_07_14/drive/image_00/data/0000000000.png", b"\x89PNG\r\n\x1a\n")
    assert readable(str(path)) == path
    store = decode(open_file(path), tmp_path / "c", protocol_set.all_protocols())
    results = {info["name"]: info for info in store.manifest["channels"]}
    info = results["angular velocity"]
    assert (info["unit"], [column["name"] for column in info["columns"]]) == ("rad/s", ["x", "y", "z"])
    rows = store.exact(info["id"], 0, 1000)
    there = np.delete(np.arange(N), 7)
    np.testing.assert_array_equal(rows.columns[0], there % 5)
    np.testing.assert_allclose(rows.time, START + there / 10, atol=1e-6)
    assert results["latitude"]["unit"] == "deg"


def test_a_folder_without_packets_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = drive(tmp_path / "drive")
    for file in (path / "oxts" / "data").iterdir():
        file.write_text("1 2 3")
    with pytest.raises(RecordingError, match="no packets") as refused:
        open_file(path)
    assert "oxts/timestamps.txt" in refused.value.hint
