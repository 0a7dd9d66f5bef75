"""A store on a real S3 server (versitygw), with a good line and a bad one.

`go install github.com/versity/versitygw/cmd/versitygw@latest` installs the server; without it these tests are skipped.
"""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.store.store import limited, location
from imuscope.server.extensions.fleet.tunnel import bandwidth_proxy
from imuscope.server.extensions.fleet.upload.upload import upload
from tests.server.extensions.fleet.store_fixtures import Commands
from tests.server.extensions.fleet.tcp_proxy import FaultyProxy
from tests.support.free_ports import free_port
from tests.support.manual_clock import SleptTime
from tests.support.server_process import ROOT
from tests.support.waiting import block_until

SERVER = shutil.which("versitygw") or shutil.which("versitygw", path=Path.home() / "go" / "bin")
pytestmark = pytest.mark.skipif(SERVER is None, reason="versitygw, an S3 server, is not installed")
STORE = "s3://drives/all"


def answers(port: int) -> bool:
    """Whether something listens."""
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def s3_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """An S3 server with a bucket, and the environment that leads to it."""
    (tmp_path / "s3" / "drives").mkdir(parents=True)
    port = free_port()
    keys = {"ROOT_ACCESS_KEY": "key", "ROOT_SECRET_KEY": "secret"}
    words = [str(SERVER), "--port", f"127.0.0.1:{port}", "posix", str(tmp_path / "s3")]
    process = subprocess.Popen(words, env={**os.environ, **keys}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        block_until(lambda: answers(port), "the S3 server")
        values = {"ENDPOINT_URL": f"http://127.0.0.1:{port}", "ACCESS_KEY_ID": "key", "SECRET_ACCESS_KEY": "secret"}
        for name, value in {**values, "REGION": "us-east-1"}.items():
            monkeypatch.setenv(f"AWS_{name}", value)
        yield port
    finally:
        process.kill()
        process.wait()


def check(commands: Commands, recording: Path, tmp_path: Path) -> None:
    """Check that the store has the recording once."""
    (row,) = commands.query(STORE, "SELECT lost, (SELECT count(*) FROM samples('RateOfTurn.x')) AS n FROM recordings")
    assert row["lost"] == 5
    assert row["n"] > 300
    (event,) = commands.query(STORE, "SELECT count(*) AS n FROM events")
    assert event == {"n": 5}
    objects = (tmp_path / "s3" / "drives" / "all" / "robots").rglob("*.mcap")
    assert [path.read_bytes() for path in objects] == [recording.read_bytes()]


@pytest.mark.usefixtures("s3_port")
def test_two_uploads_at_once_are_one(commands: Commands, recording: Path, tmp_path: Path) -> None:
    words = [
        sys.executable,
        "-m",
        "imuscope.server.cli",
        "upload",
        str(recording),
        "--store",
        STORE,
        "--robot",
        "otter",
    ]
    processes = [subprocess.Popen(words, cwd=ROOT, stdout=subprocess.DEVNULL) for _ in range(2)]
    assert [process.wait() for process in processes] == [0, 0]
    assert "was uploaded before" in commands.upload(recording, STORE)
    check(commands, recording, tmp_path)


def test_a_bad_line_is_overcome(
    s3_port: int, commands: Commands, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with FaultyProxy(s3_port) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{proxy.port}")
        commands.upload(recording, STORE)
        check(commands, recording, tmp_path)
        assert proxy.faults["503"] > 0
        assert proxy.faults["cut"] > 0


@pytest.mark.usefixtures("s3_port")
def test_an_upload_of_limited_rate_is_whole_and_not_faster(
    commands: Commands, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rate = recording.stat().st_size / 2
    monkeypatch.setattr(bandwidth_proxy, "time", slept := SleptTime())
    with limited(location(STORE), rate) as store:
        assert store.proxy
        upload(recording, store, "otter", DecodeOptions("", {}))
    assert slept.monotonic() >= 3.5, "the recording is sent, and read back after that"
    check(commands, recording, tmp_path)


@pytest.mark.usefixtures("s3_port")
def test_wrong_buckets_and_keys_are_one_line(
    commands: Commands, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for command in (("upload", recording, "--robot", "a"), ("query", "SELECT * FROM recordings")):
        assert "no such bucket" in commands.refused(*command, "--store", "s3://missing/x")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
    for command in (("upload", recording, "--robot", "a"), ("query", "SELECT * FROM recordings")):
        assert "the credentials are not accepted" in commands.refused(*command, "--store", STORE)
