"""Files of a server can be read by its user only: they may hold addresses with secrets, and positions."""

from __future__ import annotations

import stat
from pathlib import Path

from imuscope.server.library.cleanup import DataFolderLock
from tests.support.server_process import ServerProcess


def test_what_a_server_writes_is_private(tmp_path: Path) -> None:
    """Alarms, with the secrets of webhooks, and recordings could be read by all users of the machine."""
    data = tmp_path / "data"
    with ServerProcess("sim:xbus", data=data, arguments=("--record",)) as server:
        server.request("POST", "/api/devices", {"source": "sim:idtp"})
    assert stat.S_IMODE(data.stat().st_mode) == 0o700
    files = [path for path in data.rglob("*") if path.is_file() and "cache" not in path.parts]
    assert any(path.suffix == ".mcap" for path in files)
    open_to_all = [f"{stat.S_IMODE(path.stat().st_mode):o} {path.relative_to(data)}" for path in files]
    assert not [one for one in open_to_all if not one.startswith("600 ")]


def test_a_start_removes_what_a_killed_upload_left(tmp_path: Path) -> None:
    """It stayed for an hour, and took the room that a recording needed."""
    left = tmp_path / "recordings" / ".incoming" / "0123456789abcdef" / "half.mcap"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"half")
    lock = DataFolderLock(tmp_path)
    lock.begin()
    lock.end()
    assert not left.parent.exists()
