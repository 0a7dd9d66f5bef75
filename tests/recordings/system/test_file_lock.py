"""A file being written belongs to its writer alone, across processes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library import quota
from imuscope.recordings.library.probe import is_pinned
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.own_recordings import TEMPORARY_SUFFIX, is_uncompacted
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.system import file_lock
from imuscope.server.library.compaction_worker import uncompacted
from tests.recordings.mcap_files import ABOUT, read
from tests.support.read_library import ReadLibrary
from tests.support.server_process import ROOT, tied

HOLDER = """
import sys
from pathlib import Path
from imuscope.recordings.mcap.writer import McapWriter
writer = McapWriter(Path(sys.argv[1]), {})
writer.chunk("1", "rx", b"a minute of driving", 1)
print("there", flush=True)
sys.stdin.read()
writer.chunk("1", "rx", b"and another one", 2)
writer.close()
"""


def recording_elsewhere(path: Path) -> subprocess.Popen[str]:
    """Another process that records into `path` until its input ends."""
    child = subprocess.Popen(
        tied([sys.executable, "-c", HOLDER, str(path)]),
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "there\n"
    return child


def test_a_recording_of_another_process_is_neither_packed_nor_culled_nor_moved(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recording_elsewhere(path) as child:
        assert file_lock.is_written(path)
        assert not is_uncompacted(path)
        assert uncompacted(tmp_path) == []
        with pytest.raises(RecordingError, match="being recorded"):
            compact(path)
        assert quota.cull(tmp_path, 1, is_pinned) == []
        library = ReadLibrary(tmp_path)
        with pytest.raises(RecordingError, match="being recorded"):
            library.delete("drive")
        with pytest.raises(RecordingError, match="being recorded"):
            library.rename("drive", "other")
        child.communicate("")
    assert [data for _, _, data in read(path)] == [b"a minute of driving", b"and another one"]
    assert not file_lock.is_in_use(path)
    assert uncompacted(tmp_path) == [path]
    compact(path)
    assert [data for _, _, data in read(path)] == [b"a minute of driving", b"and another one"]


def test_a_killed_writer_leaves_no_lock_behind(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with recording_elsewhere(path) as child:
        child.kill()
        child.wait()
        assert not file_lock.is_in_use(path)
        assert uncompacted(tmp_path) == [path]


def test_only_dead_leftovers_of_packing_are_taken_away(tmp_path: Path) -> None:
    alive, dead = tmp_path / f".a.mcap.1{TEMPORARY_SUFFIX}", tmp_path / f".b.mcap.2{TEMPORARY_SUFFIX}"
    dead.write_bytes(b"left by a packing that was killed")
    with alive.open("w+b") as out:
        assert file_lock.share(out.fileno())
        uncompacted(tmp_path)
        assert alive.exists()
        assert not dead.exists()


def test_a_file_that_is_replaced_while_it_is_packed_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    for name, text in ((path, b"old"), (tmp_path / "new.mcap", b"new")):
        writer = McapWriter(name, ABOUT)
        writer.chunk("1", "rx", text, 1)
        writer.close()

    def replace(_: float) -> None:
        if (tmp_path / "new.mcap").exists():
            os.replace(tmp_path / "new.mcap", path)

    with pytest.raises(RecordingError, match="replaced while"):
        compact(path, progress=replace)
    assert [data for _, _, data in read(path)] == [b"new"]
    assert [one.name for one in tmp_path.iterdir()] == ["a.mcap"]
