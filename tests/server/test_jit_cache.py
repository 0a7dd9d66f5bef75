"""The cache folder of compiled code: location, filling, and fallback if it is unusable."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from imuscope.protocols import jit
from imuscope.server import jit_cache
from imuscope.server.config import Config
from imuscope.server.links.base import LinkSettings
from imuscope.server.version import VERSION
from tests.server.fakes import FakeLink
from tests.server.in_process_server import InProcessServer


@pytest.fixture(autouse=True)
def _unset(monkeypatch: pytest.MonkeyPatch) -> None:
    """No place is set; what a test sets is taken back."""
    monkeypatch.setattr(jit, "DISABLED", False)
    monkeypatch.setenv(jit_cache.VARIABLE, "")
    monkeypatch.delenv(jit_cache.VARIABLE)


def fill(place: Path) -> None:
    """The entries that numba makes, by their names."""
    for kernel in (one for one in jit._kernels if one.signature is not None):
        folder = place / kernel.__module__
        folder.mkdir(parents=True, exist_ok=True)
        for kind in ("nbi", "1.nbc"):
            (folder / f"file.{kernel.stored_name()}-.py311.{kind}").write_bytes(b"")


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


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_cache_that_lacks_a_loop_is_not_taken_for_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """A server that was killed while it compiled left some files; the next one compiled the rest without a word."""
    fill(tmp_path)
    monkeypatch.setenv(jit_cache.VARIABLE, str(tmp_path))
    assert jit_cache.is_filled()
    next(tmp_path.rglob(f"*.{kind}")).unlink()
    assert not jit_cache.is_filled()


def test_nothing_is_compiled_in_the_event_loop_while_a_server_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Links were opened before decoders were told not to load: the server answered nothing for minutes."""
    monkeypatch.setattr(jit, "automatic", True)
    may_load = []

    def open_link(source: str, settings: LinkSettings) -> FakeLink:
        may_load.append(jit.automatic)
        return FakeLink(source, settings)

    with InProcessServer(Config(data=tmp_path, sources=("fake",)), open_link):
        assert may_load == [False]


def test_a_server_without_devices_compiles_with_its_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It never loaded in the background, so its first device loaded in the event loop."""
    monkeypatch.setattr(jit, "automatic", True)
    loads: list[str] = []
    monkeypatch.setattr(jit_cache, "load", lambda **_: loads.append(threading.current_thread().name))
    with InProcessServer(Config(data=tmp_path), FakeLink, has_devices=False) as running:
        assert (jit.automatic, loads) == (False, [])
        for source in ("one", "two"):
            running.call(running.services.sessions.add, source)
    assert loads == ["loading compiled code"]


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
