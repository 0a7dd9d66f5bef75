"""The cache folder of compiled code: location, filling, and fallback if it is unusable."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from imuscope.protocols import jit
from imuscope.server import jit_cache
from imuscope.server.version import VERSION


@pytest.fixture(autouse=True)
def _unset(monkeypatch: pytest.MonkeyPatch) -> None:
    """No place is set; what a test sets is taken back."""
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setenv(jit_cache.VARIABLE, "")
    monkeypatch.delenv(jit_cache.VARIABLE)


def fill(place: Path) -> None:
    """An entry as numba makes it, by its name."""
    (place / "protocols_0").mkdir(parents=True)
    (place / "protocols_0" / "checksums.sum8.nbi").write_bytes(b"index")


def test_compiled_code_lies_under_the_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not jit_cache.is_there(tmp_path / "data")
    assert jit_cache.prepare_cache(tmp_path / "data") == []
    place = Path(os.environ[jit_cache.VARIABLE])
    assert place == tmp_path / "data" / "compiled" / VERSION
    assert not jit_cache.is_filled()
    fill(place)
    assert jit_cache.is_filled()
    monkeypatch.delenv(jit_cache.VARIABLE)
    assert jit_cache.is_there(tmp_path / "data")


def test_former_versions_are_removed(tmp_path: Path) -> None:
    fill(tmp_path / "compiled" / "0.0.1")
    jit_cache.prepare_cache(tmp_path)
    assert [one.name for one in (tmp_path / "compiled").iterdir()] == [VERSION]


def test_a_place_that_is_given_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(jit_cache.VARIABLE, str(tmp_path / "given"))
    assert jit_cache.prepare_cache(tmp_path / "data") == []
    assert os.environ[jit_cache.VARIABLE] == str(tmp_path / "given")


def test_a_read_only_place_will_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container image is warmed when it is built and read-only when it runs; numba uses no such cache."""
    given = tmp_path / "given"
    fill(given)
    monkeypatch.setenv(jit_cache.VARIABLE, str(given))
    monkeypatch.setattr(jit_cache, "_writable", lambda folder: False)
    assert jit_cache.prepare_cache(tmp_path) == []
    assert os.environ[jit_cache.VARIABLE] != str(given)
    assert jit_cache.is_filled()


def test_an_empty_cache_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(jit_cache.VARIABLE, str(tmp_path / "none"))
    monkeypatch.setattr(jit_cache, "_writable", lambda folder: False)
    [words] = jit_cache.prepare_cache(tmp_path)
    assert "for this run only" in words
    assert Path(os.environ[jit_cache.VARIABLE]).is_dir()


def test_an_unwritable_cache_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(jit_cache.VARIABLE, "/proc/none")

    def refuse(prefix: str) -> str:
        raise OSError("read-only")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    [words] = jit_cache.prepare_cache(tmp_path)
    assert "for this run only" in words
    assert jit_cache.VARIABLE not in os.environ


def test_a_cache_that_is_cut_short_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba does not write through to the disk, so a power cut leaves empty files."""
    fill(tmp_path)
    monkeypatch.setenv(jit_cache.VARIABLE, str(tmp_path))
    monkeypatch.setattr(jit, "is_loaded", lambda: False)
    found: list[bool] = []

    def load(stop: object) -> None:
        found.append(tmp_path.exists())
        if tmp_path.exists():
            raise EOFError

    monkeypatch.setattr(jit, "load", load)
    jit_cache.load(report=print)
    assert found == [True, False]


def test_loading_beside_a_server_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """First start: two processes compile, the page is notified, and shutdown does not wait for them."""
    monkeypatch.setenv(jit_cache.VARIABLE, str(tmp_path / "compiled"))
    monkeypatch.setattr(jit, "is_loaded", lambda: False)
    monkeypatch.setattr(jit, "automatic", True)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    told: list[str] = []
    with jit_cache.BackgroundLoad(told.append):
        assert not jit.automatic
    assert told == [jit_cache.COMPILING]
