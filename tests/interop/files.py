"""Files and streams of imuscope in third-party programs."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.interop.running import DiffersError, from_pip, imuscope, run
from tests.server.extensions.corrections.correction_messages import STREAM
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client

PYMCAP = "pymcap-cli==0.34.0"
PYGNSSUTILS = "pygnssutils==1.3.1"
PASSED = {"1005", "1230"}  # of STREAM; the observations in it are filling, which the caster leaves out


def mcap(folder: Path, scratch: Path) -> str:
    """pymcap-cli accepts a recording and its decoded export, and recovers most of a truncated one."""
    program = str(from_pip(folder, PYMCAP, "pymcap-cli"))
    made, out, torn, saved = (scratch / f"{name}.mcap" for name in ("made", "out", "torn", "saved"))
    imuscope("record", "sim:xbus?product=MTi-680G", "-o", str(made), "--duration", "5")
    imuscope("decode", str(made), "-o", str(out))
    for path in (made, out):
        for line in run([program, "doctor", "--format", "jsonl", str(path)], scratch).splitlines():
            document = json.loads(line)
            if document.get("severity") in ("warning", "error"):
                raise DiffersError(f"{path.name}: {line}")
    whole = made.read_bytes()
    torn.write_bytes(whole[: len(whole) * 3 // 4])
    subprocess.run([program, "recover", str(torn), "-o", str(saved)], cwd=scratch, capture_output=True, check=False)
    stored, of = (_report_of(program, path, scratch)["statistics"]["message_count"] for path in (saved, made))
    if stored < of * 0.6:
        raise DiffersError(f"of a recording cut at three quarters {stored} of {of} messages were saved")
    topics = {one["topic"] for one in _report_of(program, out, scratch)["channels"]}
    if missing := {"/MTi-680G/attitude", "/MTi-680G/position", "/MTi-680G/Acceleration"} - topics:
        raise DiffersError(f"the export has no {', '.join(sorted(missing))}")
    return f"nothing wrong; {stored} of {of} messages saved from three quarters of a recording"


def _report_of(program: str, path: Path, scratch: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(run([program, "info-json", str(path)], scratch))
    return document


def rerun(folder: Path, scratch: Path) -> str:
    """Rerun's own command, installed with imuscope, verifies an .rrd export without a warning."""
    made, out = scratch / "made.mcap", scratch / "out.rrd"
    imuscope("record", "sim:isb", "-o", str(made), "--duration", "3")
    imuscope("decode", str(made), "-o", str(out))
    program = Path(sys.executable).with_name("rerun")
    done = subprocess.run(
        [str(program), "rrd", "verify", str(out)], cwd=scratch, capture_output=True, text=True, timeout=300
    )
    message = done.stdout + done.stderr
    if done.returncode or "WARN" in message or "ERROR" in message:
        raise DiffersError(f"rerun rrd verify ended with {done.returncode}:\n{message[-1500:]}")
    return message.strip().splitlines()[-1] if message.strip() else "verified"


def pygnssutils(folder: Path, scratch: Path) -> str:
    """Corrections reach a simulated MTi-680G through pygnssutils' NTRIP caster, in both versions of NTRIP."""
    program = str(from_pip(folder, PYGNSSUTILS, "gnssserver"))
    with (
        _base() as base,
        ServerProcess("sim:xbus?product=MTi-680G", data=scratch / "data") as server,
        http_client(base_url=server.url) as client,
    ):
        _until(client, "/api/devices", lambda devices: devices[0]["status"] == "live")
        for version in ("1.0", "2.0"):
            port = free_port()
            command = [program, "--socket", f"127.0.0.1:{base}", "--hostip", "127.0.0.1", "--outport", str(port)]
            command += ["--ntripmode", "1", "--ntripversion", version, "--ntripuser", "me", "--ntrippassword", "secret"]
            with subprocess.Popen(command, cwd=scratch, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as caster:
                try:
                    path = "/api/devices/1/corrections"
                    source = {"source": f"ntrip://me:secret@127.0.0.1:{port}/pygnssutils"}
                    client.put(path, json=source).raise_for_status()
                    state = _until(client, path, lambda state: state["messages"].keys() >= PASSED)
                    if state["rejected"] or state["refused"] or not state["forwarding"]:
                        raise DiffersError(f"NTRIP {version}: {state}")
                    client.delete(path).raise_for_status()
                finally:
                    caster.terminate()
    return "messages of both versions of NTRIP reached the device"


@contextmanager
def _base() -> Iterator[int]:
    """A base station that sends RTCM 3 to every client twice a second; returns its port."""
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while not ended.is_set():
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                threading.Thread(target=send, args=(connection,), daemon=True).start()

        def send(connection: socket.socket) -> None:
            with connection:
                try:
                    while not ended.wait(0.5):
                        connection.sendall(STREAM)
                except OSError:
                    return

        threading.Thread(target=serve, daemon=True).start()
        try:
            yield int(server.getsockname()[1])
        finally:
            ended.set()


def _until(client: httpx.Client, path: str, true: Any, seconds: float = 90.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        body = client.get(path).json()
        if true(body):
            return body
        time.sleep(0.1)
    raise DiffersError(f"{path} never came to be so: {body}")
