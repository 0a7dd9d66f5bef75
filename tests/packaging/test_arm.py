"""imuscope on 64-bit ARM, by emulation: the same answers, bit for bit, as on this machine."""

import json
import subprocess
import urllib.request
from collections.abc import Iterator
from math import isclose
from pathlib import Path

import pytest

from tests.packaging.arm_machine import ArmMachine, NoEmulationError
from tests.protocols.damaged_streams import write_streams
from tests.protocols.decoder_digests import digests
from tests.support.server_process import imuscope
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

pytestmark = pytest.mark.slow
FAMILIES = ("idtp", "isb", "xbus")


@pytest.fixture(scope="module")
def machine() -> ArmMachine:
    try:
        return ArmMachine()
    except NoEmulationError as error:
        pytest.skip(f"no emulated machine: {error}")


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("streams")
    write_streams(folder)
    return folder


def test_decoders_give_the_same(machine: ArmMachine, streams: Path) -> None:
    """As machine code, of which none is missing."""
    assert machine.run("-c", "import platform; print(platform.machine())").strip() == "aarch64"
    assert machine.run("-m", "tests.protocols.decoder_digests", streams).strip() == f"0 {digests(streams)}"


def assert_same_tables(here: Path, there: Path) -> int:
    """The same files with the same text in each cell; angles computed by the C library may differ in the last digit of
    a double. Returns the number of rows.
    """
    assert sorted(path.name for path in there.iterdir()) == sorted(path.name for path in here.iterdir())
    rows = 0
    for path in here.iterdir():
        pairs = zip(path.read_text().splitlines(), (there / path.name).read_text().splitlines(), strict=True)
        for one, other in pairs:
            rows += 1
            if one != other:
                cells = zip(one.split(","), other.split(","), strict=True)
                assert all(a == b or isclose(float(a), float(b), rel_tol=1e-15) for a, b in cells), (
                    path.name,
                    one,
                    other,
                )
    return rows


def test_exports_are_the_same(machine: ArmMachine, streams: Path, tmp_path: Path) -> None:
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    for family in FAMILIES:
        words = ("decode", str(streams / family), "--protocol", family, "--data", str(tmp_path / "data"), "-o")
        assert imuscope(*words, str(tmp_path / "here" / f"{family}.csv")).returncode == 0
        machine.run("-m", "imuscope", *words, tmp_path / "there" / f"{family}.csv")
    assert assert_same_tables(tmp_path / "here", tmp_path / "there") > 5_000


@pytest.fixture
def server(machine: ArmMachine, tmp_path: Path) -> Iterator[str]:
    """Address of a server that records three simulated devices."""
    words = ("serve", "--port", "0", "--data", tmp_path, "--record", *(f"sim:{family}?rate=20" for family in FAMILIES))
    process = subprocess.Popen(
        machine.command("-m", "imuscope", *words),
        env=machine.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    try:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line.startswith("http://"):
                break
        assert lines, "it printed nothing"
        assert lines[-1].startswith("http://"), "".join(lines)
        yield lines[-1].strip()
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


def get(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        data: bytes = answer.read()
        return data


def test_a_server_records_what_both_decode_alike(machine: ArmMachine, server: str, tmp_path: Path) -> None:
    assert b"<title>" in get(server)
    devices = lambda: json.loads(get(f"{server}api/devices"))  # noqa: E731
    live = lambda: [one["status"] for one in devices()] == ["live"] * len(FAMILIES)  # noqa: E731
    block_until(live, devices, seconds=3 * PATIENCE_S)
    recorder = lambda: json.loads(get(f"{server}api/recorder"))  # noqa: E731
    block_until(lambda: recorder()["bytes"] > 50_000, recorder, seconds=3 * PATIENCE_S)
    request = urllib.request.Request(f"{server}api/recordings/stop", method="POST")
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        assert answer.status == 200
    [recording] = (tmp_path / "recordings").glob("*.mcap")
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    words = ("decode", str(recording), "--data", str(tmp_path / "data"), "-o")
    assert imuscope(*words, str(tmp_path / "here" / "all.csv")).returncode == 0
    machine.run("-m", "imuscope", *words, tmp_path / "there" / "all.csv")
    assert assert_same_tables(tmp_path / "here", tmp_path / "there") > 200
