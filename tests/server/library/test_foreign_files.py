"""Files from outside are read in other processes: what the server's own can import, and what a call may take."""

from __future__ import annotations

import ast
import asyncio
import functools
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.file_suffixes import OF_READERS
from imuscope.recordings.readers.registry import reader_suffixes
from imuscope.server.library import foreign_files
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.services.extension import extensions
from tests.support.processes import is_running
from tests.support.source_files import ROOT
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

READERS = (
    *("importers", "probe", "table_preview", "tabular", "mcap_reader", "mcap_source", "message_source", "download"),
    *("compaction", "bounded_yaml", "readers.formats"),
)
FORBIDDEN = (
    *(f"imuscope.recordings.{name}" for name in READERS),
    *("yaml", "sqlite3", "apsw", "pyfive", "h5py", "rosbags", "lz4", "zipfile", "tarfile", "bz2", "lzma", "gzip"),
)
"""What reads files, and parsers of YAML, SQL, HDF5 and archives."""
ALLOWED = {
    (
        "imuscope.server.extensions.fleet.query.database",
        "sqlite3",
    ): "the database of a fleet server, which alone writes it",
    ("imuscope.server.extensions.rerun.assets", "gzip"): "packs files of an installed package",
    ("imuscope.server.extensions.rerun.routes", "gzip"): "sends them",
    ("imuscope.server.commands.common", "imuscope.recordings.readers.formats"): "names of folders only",
}
LISTED = "imuscope.recordings.exporters"  # modules that a server imports for its list of formats, and does not run


def _source(module: str) -> Path | None:
    """The file of one of our modules."""
    words = module.split(".")
    if words[0] != "imuscope":
        return None
    base = (
        ROOT.joinpath(*words[1:])
        if words[1:2] in (["server"], ["recordings"], ["protocols"])
        else ROOT.joinpath(*words)
    )
    return next((one for one in (base.with_suffix(".py"), base / "__init__.py") if one.is_file()), None)


@functools.cache
def _imports(module: str) -> frozenset[str]:
    """What a module imports, also within its functions, but not for types alone."""
    path = _source(module)
    results: set[str] = set()
    stack: list[ast.AST] = [ast.parse(path.read_text())] if path is not None else []
    while stack:
        node = stack.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and module.startswith(LISTED):
            continue
        if isinstance(node, ast.Import):
            results |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            results |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
        stack += ast.iter_child_nodes(node)
    parts = [one.split(".") for one in results]
    return frozenset(".".join(words[:count]) for words in parts for count in range(1, len(words) + 1))


def _first_modules() -> Iterator[str]:
    """Modules of the server's process that nobody imports by name: routes, links, formats, extensions."""
    yield from ("imuscope.server.app.build", "imuscope.server.http.server", "imuscope.server.commands.serve")
    for folder in ("server/api", "server/links", "recordings/exporters/formats"):
        for path in (ROOT / folder).glob("*.py"):
            yield f"imuscope.{folder.replace('/', '.')}.{path.stem}".removesuffix(".__init__")
    for one in extensions():
        yield from filter(None, (one.parts, one.page_parts, *one.routes))


def test_no_reader_of_files_is_in_the_servers_process() -> None:
    """An upload of 891 bytes ended the server: what looked into it ran there."""
    ways: dict[str, str] = dict.fromkeys(_first_modules(), "")
    waiting = list(ways)
    offenders = []
    while waiting:
        module = waiting.pop()
        for one in sorted(_imports(module) - ways.keys()):
            if any(module == user and one.startswith(used) for user, used in ALLOWED):
                continue
            ways[one] = module
            waiting.append(one)
            if any(one == name or one.startswith(f"{name}.") for name in FORBIDDEN):
                way = [one]
                while ways.get(way[-1]):
                    way.append(ways[way[-1]])
                offenders.append(" <- ".join(way))
    assert len(ways) > 400, "the walk has found nothing"
    assert not offenders, "\n".join(offenders)


def test_suffixes_are_known_without_the_readers() -> None:
    assert reader_suffixes() == OF_READERS


# ── calls ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def _busy(path: Path) -> None:
    """What never returns to Python: no signal is handled within it."""
    "a" * 10 in "a" * 9 + "b"  # noqa: B015
    sum(iter(int, 1))


def _asleep(path: Path) -> None:
    time.sleep(3600)


def _greedy(path: Path) -> int:
    return len(bytearray(1 << 40))


def _crashed(path: Path) -> None:
    import ctypes

    ctypes.string_at(0)


def _endless(path: Path) -> str:
    return "a" * (2 * foreign_files.MAX_ANSWER)


HERE = "tests.server.library.test_foreign_files"


@pytest.mark.parametrize(
    ("function", "words"),
    [
        ("_busy", "ended its process"),
        ("_asleep", "takes too long"),
        ("_greedy", "exceeds the memory limit"),
        ("_crashed", "ended its process"),
        ("_endless", "holds too much"),
    ],
)
async def test_a_call_that_does_not_end_costs_itself_only(
    function: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers were alive 500 s after their recordings were deleted: a limit of time has no effect within C."""
    monkeypatch.setattr(foreign_files, "QUICK_S", 1)
    monkeypatch.setattr(foreign_files, "WAIT_S", 2 if function == "_asleep" else PATIENCE_S)
    monkeypatch.setattr(foreign_files, "WAIT_SHARE", 0)
    path = tmp_path / "made.bag"
    path.write_bytes(b"x")
    files = ForeignFiles()
    try:
        with pytest.raises(RecordingError, match=words) as refused:
            await files.call(f"{HERE}:{function}", path, returns=int)
        assert refused.value.message.startswith(("Reading made.bag", "made.bag"))
        assert await files.call("imuscope.recordings.library.table_preview:heading_of", path, returns=list[str]) == []
    finally:
        await files.close()


def _imported(path: Path) -> list[str]:
    from imuscope.recordings.library import table_preview
    from imuscope.recordings.tables.options import TableOptions

    before = set(sys.modules)
    assert table_preview.preview_of(path, TableOptions()) is not None
    return sorted(set(sys.modules) - before)


async def test_what_a_preview_needs_was_imported_ahead(tmp_path: Path) -> None:
    """A preview took 0.3 s, of which two thirds went into imports."""
    path = tmp_path / "made.csv"
    path.write_text("time (s),x\n" + "".join(f"{n / 100},{n}\n" for n in range(50)))
    files = ForeignFiles()
    try:
        assert await files.call(f"{HERE}:_imported", path, returns=list[str]) == []
    finally:
        await files.close()


def _without_end(path: Path, out: BinaryIO) -> None:
    out.write(os.getpid().to_bytes(4, "little"))
    while True:
        out.write(bytes(1 << 16))


async def test_a_download_that_is_aborted_ends_what_writes_it(tmp_path: Path) -> None:
    """Each kept one of the few threads of the server: after some, no request that needs one was answered."""
    files = ForeignFiles()
    try:
        pieces = files.pieces(f"{HERE}:_without_end", tmp_path)
        pid = int.from_bytes((await anext(pieces))[:4], "little")
        assert is_running(pid)
        await pieces.aclose()
        await until(lambda: not is_running(pid), "its process has ended")
    finally:
        await files.close()


async def test_a_call_ends_with_its_client(tmp_path: Path) -> None:
    """Twelve requests that nobody waited for any more kept twelve threads of the server."""
    files = ForeignFiles()
    try:
        calls = [
            asyncio.ensure_future(files.call(f"{HERE}:_asleep", tmp_path, returns=int, user="a"))
            for _ in range(2 * foreign_files.RUNNING_EACH)
        ]
        await asyncio.sleep(0.1)
        for one in calls:
            one.cancel()
        await asyncio.gather(*calls, return_exceptions=True)
        assert (
            await files.call(
                "imuscope.recordings.library.table_preview:heading_of", tmp_path, returns=list[str], user="a"
            )
            == []
        )
    finally:
        await files.close()
