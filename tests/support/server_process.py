"""Real server processes for tests and benchmarks, on a port chosen by the system.

It never outlives who started it, however that one ended: a server that is left behind goes on trying its serial port,
and so takes the next run's pseudo-terminal, which has the same name, before the server of that run is there.
"""

from __future__ import annotations

import json
import os
import re
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.support.forking.fork_server import Child, ForkServer
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

ROOT = Path(__file__).resolve().parents[2]

# Runs what follows it in its place, to be ended by Linux with the process whose number is given first. The signal is
# PR_SET_PDEATHSIG (1) of prctl(2); it is kept over exec. (A preexec_fn would run Python between fork and exec.)
_TIED = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, int(signal.SIGTERM))
for number in (signal.SIGHUP, signal.SIGINT):  # ignored where the tests run under nohup, or a script's background
    signal.signal(number, signal.SIG_DFL)
if os.getppid() != int(sys.argv[1]): sys.exit("who asked for this has ended")
os.execv(sys.argv[2], sys.argv[2:])
"""


def tied(command: list[str]) -> list[str]:
    """The command line that runs `command` (its first word a path) until it ends or this process does, even killed."""
    if sys.platform != "linux":
        return command
    return [sys.executable, "-I", "-S", "-c", _TIED, str(os.getpid()), *command]


begun_last: deque[ServerProcess] = deque(maxlen=2)
"""The servers that were started last; a failing test shows what they printed."""

# Whom tests have start what they need (tests/conftest.py); without it, each command is an interpreter of its own.
nursery: ForkServer | None = None


def forked() -> list[Child]:
    """What a nursery of another process has begun for this one."""
    return nursery.children if nursery is not None else []


def begun(
    *words: str,
    fresh: bool = False,
    prefix: Sequence[str] = (),
    apart: bool = False,
    module: str = "",
    by: ForkServer | None = None,
) -> subprocess.Popen[str] | Child:
    """`imuscope WORDS`, running, in a process group of its own: an interrupted run of tests stops it through who began
    it, not behind their back.

    Args:
        fresh: in an interpreter of its own, also where tests share the work of starting one.
        prefix: put before the command, to run it as somebody else.
        apart: what is printed as an error has a pipe of its own.
        module: runs instead of the command line, with these words.
        by: forks it instead of the fork server that all tests share.
    """
    forking = by or nursery
    if forking is not None and not fresh and not prefix:
        pipes = [os.pipe() for _ in range(1 + apart)]
        with open(os.devnull) as nothing:
            child = forking.start(words, nothing.fileno(), pipes[0][1], pipes[-1][1], module=module)
        for _, written in pipes:
            os.close(written)
        child.stdout, *errors = (os.fdopen(read, encoding="utf-8", errors="replace") for read, _ in pipes)
        child.stderr = errors[0] if errors else None
        return child
    return subprocess.Popen(
        [*prefix, *tied([sys.executable, "-m", module or "imuscope.server.cli", *words])],
        cwd=ROOT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE if apart else subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    )


def imuscope(
    *words: str, stdin: bytes = b"", fresh: bool = False, by: ForkServer | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `imuscope WORDS` to its end.

    Args:
        fresh: in a separate interpreter, also where tests share start-up work.
        by: starts it instead of the fork server that all tests share.
    """
    by = by or nursery
    with tempfile.TemporaryFile() as request, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        request.write(stdin)
        request.seek(0)
        if by is not None and not fresh:
            status = by.start(words, request.fileno(), out.fileno(), err.fileno()).wait(PATIENCE_S)
        else:
            command = [sys.executable, "-m", "imuscope.server.cli", *words]
            status = subprocess.run(
                command, cwd=ROOT, stdin=request, stdout=out, stderr=err, timeout=PATIENCE_S
            ).returncode
        for file in (out, err):
            file.seek(0)
        return subprocess.CompletedProcess(words, status, out.read().decode(), err.read().decode())


class ServerProcess:
    """`imuscope serve SOURCE …`, or another command that serves the page, started and waited for until it answers.

    Args:
        sources: as on the command line; none starts what the command starts by itself.
        data: the data folder.
        arguments: further options.
        prefix: put before the command, to run it as somebody else.
        timeout_s: time allowed until /healthz answers (a first start compiles).
        fresh: start an interpreter for it, also where tests share the work of that
            (tests/support/forking/fork_server.py).
        by: fork server to use instead of the one that all tests share.
        module: runs instead of the command line, with its words.

    Raises:
        RuntimeError: the server ended or did not answer; the message holds what it printed.
    """

    def __init__(
        self,
        *sources: str,
        data: Path,
        arguments: tuple[str, ...] = (),
        prefix: tuple[str, ...] = (),
        timeout_s: float = 180,
        fresh: bool = False,
        command: str = "serve",
        by: ForkServer | None = None,
        module: str = "",
    ) -> None:
        words = [command, *sources, "--host", "127.0.0.1", "--port", "0", "--data", str(data), *arguments]
        self.process = begun(*words, fresh=fresh, prefix=prefix, by=by, module=module)
        self.data = data
        self.lines: list[str] = []
        self._certificate = data / "tls" / "certificate.pem"
        if "--tls-cert" in arguments:
            self._certificate = Path(arguments[arguments.index("--tls-cert") + 1])
        self._is_beyond_loopback = "0.0.0.0" in arguments
        self._address = threading.Event()
        self.url = ""
        begun_last.append(self)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._wait(timeout_s)
        except BaseException:
            self.stop()
            raise

    @property
    def trust(self) -> ssl.SSLContext | None:
        """Trust of a client: only the server's certificate; None without TLS."""
        if not self.url.startswith("https"):
            return None
        return ssl.create_default_context(cafile=self._certificate)

    @property
    def log(self) -> str:
        """Everything printed so far."""
        return "".join(self.lines)

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """One request to its API, the answer read from JSON."""
        content, head = None if body is None else json.dumps(body).encode(), {"content-type": "application/json"}
        request = urllib.request.Request(f"{self.url.rstrip('/')}{path}", content, head, method=method)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.loads(answer.read() or b"null")

    def wait_until_open(self, devices: int) -> None:
        """Wait until so many silent devices have their ports open: a port that is opened discards what came before."""
        block_until(
            lambda: sum("is open" in one["message"] for one in self.request("GET", "/api/devices")) == devices,
            lambda: f"{devices} open ports: {self.request('GET', '/api/devices')}",
        )

    def stop(self) -> int:
        """End the process, kindly first. Returns its exit status."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
        status = self.process.wait()
        self._reader.join(PATIENCE_S)  # subprocesses of a killed server end a little later
        if self.process.stdout:
            self.process.stdout.close()
        return status

    def __enter__(self) -> ServerProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            self.lines.append(line)
            if not self.url and (match := re.search(r"https?://[\w.:\[\]-]+", line)):
                url = match[0].rstrip("/")
                # The machine's own name is printed then, which not every machine can look up.
                self.url = re.sub(r"//.*(?=:)", "//localhost", url) if self._is_beyond_loopback else url
                self._address.set()
        self._address.set()

    def _wait(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        self._address.wait(timeout_s)
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                break
            if self.url and self._answers():
                return
            time.sleep(0.02)
        raise RuntimeError(f"the server did not come up:\n{self.log}")

    def _answers(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.url}/healthz", timeout=PATIENCE_S, context=self.trust) as answer:
                return bool(answer.status == 200)
        except OSError:
            return False
