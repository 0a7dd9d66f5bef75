"""A library with things in it that are no files, or that no name can be written for: the others are well."""

from __future__ import annotations

import ast
import os
import socket
from pathlib import Path

import httpx
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library import quota
from imuscope.recordings.library.library import INDEX
from imuscope.recordings.library.probe import is_pinned
from imuscope.recordings.sidecar import Edits, sidecar_path
from imuscope.server.library.compaction_worker import uncompacted
from tests.recordings.store_fixtures import recording
from tests.support.read_library import ReadLibrary
from tests.support.server_process import ServerProcess
from tests.support.source_files import ROOT, python_files

UNKNOWN = "\N{REPLACEMENT CHARACTER}"


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    """What a backup, a crash or somebody else may leave, beside a recording."""
    folder = tmp_path / "recordings"
    (folder / INDEX).mkdir(parents=True)
    recording(folder / "fine.mcap")
    for name in ("pipe.mcap", "pipe.bin", sidecar_path(Path("fine.mcap")).name, f"{INDEX}/fine.mcap.json"):
        os.mkfifo(folder / name)
    with socket.socket(socket.AF_UNIX) as listener, pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # an address is short
        listener.bind("socket.mcap")
    for name, target in (("device", "/dev/zero"), ("circle", "circle.mcap"), ("gone", "nowhere")):
        (folder / f"{name}.mcap").symlink_to(target)
    (folder / "folder.mcap").mkdir()
    for name in (b"\xff.mcap", b"\xfe.mcap", b"\xff.txt"):
        (folder / os.fsdecode(name)).write_bytes(b"no")
    return folder


def test_things_that_are_no_files_are_listed_with_the_reason(odd: Path) -> None:
    """A server waited for a writer of the pipe, and never started."""
    library = ReadLibrary(odd)
    results = {entry.id: entry.probe.damaged for entry in library.all()}
    assert results.pop("fine").startswith("fine.mcap.json is damaged")
    assert set(results) == {
        *("pipe", "pipe.bin", "socket", "device", "circle", "gone", "folder"),
        *(UNKNOWN, f"{UNKNOWN}.mcap"),  # the second, as of any two files of one stem
    }
    assert all(why.endswith(".") for why in results.values())
    assert "a pipe or a device" in results["pipe"]
    assert "not UTF-8" in results[UNKNOWN]
    assert uncompacted(odd) == [odd / "fine.mcap"]
    assert library.edit("fine", Edits(title="Mine")).title == "Mine"
    quota.cull(odd, 1, is_pinned)
    for name in results:
        with pytest.raises(RecordingError):
            open_file(library.path(name))


def test_a_file_whose_name_is_not_utf_8_can_be_renamed(odd: Path) -> None:
    library = ReadLibrary(odd)
    assert library.rename(UNKNOWN, "better").id == "better"
    assert library.get("better").probe.damaged == "It is not a format imuscope knows."


def test_a_server_starts_lists_and_ends_beside_them(odd: Path) -> None:
    with ServerProcess("udp://:0", data=odd.parent) as server:
        listed = httpx.get(f"{server.url}/api/recordings").raise_for_status().json()
        assert {"fine", "pipe", UNKNOWN} <= {one["id"] for one in listed}
        assert server.stop() == 0


OPENS_ITS_OWN = {
    "recordings/system/resource_limits.py": "of the kernel",
    "recordings/columns/store.py": "in a folder of ours",
    "recordings/columns/payloads.py": "in a folder of ours",
    "recordings/readers/formats/compressed.py": "entries of an open archive",
    "recordings/readers/formats/numpy_arrays.py": "entries of an open archive",
    "recordings/system/regular_file.py": "the one place",
}


def test_recordings_are_opened_in_one_place() -> None:
    """`path.open("rb")` waits for ever for a pipe."""
    opening = {"open", "read_bytes", "read_text"}
    results = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in python_files("recordings")
        if str(path.relative_to(ROOT)) not in OPENS_ITS_OWN
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in opening
        and not {"w", "x"} & set("".join(str(one.value) for one in node.args if isinstance(one, ast.Constant)))
        and ast.unparse(node.func) not in ("os.open", "pa.csv.open_csv")
    ]
    assert not results, f"use recordings/system/regular_file.py: {results}"
