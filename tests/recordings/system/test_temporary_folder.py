"""Temporary folders: each is removed by its process, or else by the next one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from imuscope.recordings.system.temporary_folder import TemporaryFolder

# Prints the path of its folder, and is killed.
KILLED = """
import os
from imuscope.recordings.system.temporary_folder import TemporaryFolder
folder = TemporaryFolder()
(folder.path / "drive.csv").write_text("1,2,3")
print(folder.path, flush=True)
os.kill(os.getpid(), 9)
"""


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def aged(path: Path) -> Path:
    """The folder, as if it had been made at another time."""
    os.utime(path, (0, 0))
    return path


def killed(temporary: Path) -> Path:
    """The folder of a process that was killed."""
    env = {**os.environ, "TMPDIR": str(temporary)}
    done = subprocess.run([sys.executable, "-c", KILLED], env=env, capture_output=True, text=True)
    return Path(done.stdout.strip())


def test_the_folder_of_a_killed_process_is_removed_by_the_next(temporary: Path) -> None:
    """An unpacked archive of gigabytes stayed until the computer was started again."""
    left = killed(temporary)
    assert (left / "drive.csv").exists()
    with TemporaryFolder() as young:
        assert left.exists()  # its process may be about to lock it
        with TemporaryFolder() as second:
            aged(left), aged(young)
            with TemporaryFolder() as third:
                assert sorted(temporary.iterdir()) == sorted((young, second, third))
    assert not [*temporary.iterdir()]


def test_what_others_have_there_is_left_alone(temporary: Path) -> None:
    for name in ("imuscope-notes", "imuscope-tmp-file"):
        (temporary / name).mkdir() if name == "imuscope-notes" else (temporary / name).write_text("mine")
        aged(temporary / name)
    (temporary / "imuscope-tmp-link").symlink_to(temporary / "imuscope-notes")
    before = {*temporary.iterdir()}
    with TemporaryFolder() as own:
        assert {*temporary.iterdir()} == {*before, own}


def test_without_locks_nothing_is_removed(temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = aged(killed(temporary))
    monkeypatch.setattr("imuscope.recordings.system.temporary_folder.is_in_use", lambda path: False)
    with TemporaryFolder():
        assert left.exists()
