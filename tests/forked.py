"""How do tests get a server without the seconds of CPU that each start takes? From a process that has started already.

    test process ── socket pair ──> nursery: has imported the server, opened and served nothing; one thread
         │                             │ fork, for every server that is asked for
         │  pipe: what it prints       ▼
         └────────────────────────── server: `server.cli.main([...])`, in a session of its own

What runs from there on is what `imuscope serve` runs. What an import may leave behind in one process is not seen this
way, and neither is the command line in the process's title: tests of these, and of the start, ask for a start of their
own (`ServerProcess(fresh=True)`), which is also what every benchmark gets, and every system but Linux.

A request is one message: JSON {argv, env}, with two descriptors: where to print, and where to tell the end (its status
as subprocess has it: negative for a signal). The answer is the process's id. The nursery ends when the test process
does, and the servers with the nursery.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
PR_SET_PDEATHSIG = 1  # prctl(2)
IS_THERE = sys.platform == "linux"


class Child:
    """A forked server, with as much of `subprocess.Popen` as tests use."""

    def __init__(self, pid: int, command: list[str], stdout: IO[str], end: socket.socket) -> None:
        self.pid = pid
        self.args = command
        self.stdout: IO[str] | None = stdout
        self.returncode: int | None = None
        self._end = end
        self._lock = threading.Lock()

    def poll(self) -> int | None:
        """Its exit status, or None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.wait(0)
        return None

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status, when it has one.

        Raises:
            subprocess.TimeoutExpired: it still runs.
        """
        with self._lock:
            if self.returncode is None:
                if not select.select([self._end], [], [], timeout)[0]:
                    raise subprocess.TimeoutExpired(self.args, timeout or 0)
                told = self._end.recv(16)
                self.returncode = int(told) if told else -signal.SIGKILL  # with the nursery, if that was killed
                self._end.close()
            return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Nursery:
    """The process that forks, begun with the first server that is asked for."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._line: socket.socket | None = None

    def start(self, arguments: list[str]) -> Child:
        """`imuscope ARGUMENTS`, running."""
        with self._lock:
            if self._line is None:
                self._line = self._begin()
            out, out_end = os.pipe()
            end, end_end = socket.socketpair()
            request = json.dumps({"argv": arguments, "env": dict(os.environ)}).encode()
            socket.send_fds(self._line, [request], [out_end, end_end.fileno()])
            os.close(out_end)
            end_end.close()
            pid = int(self._line.recv(16) or 0)
            if not pid:
                raise RuntimeError("the process that forks servers has ended: see what it printed")
        return Child(pid, arguments, os.fdopen(out, encoding="utf-8", errors="replace"), end)

    def _begin(self) -> socket.socket:
        own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.forked", str(other.fileno())],
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            pass_fds=[other.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        other.close()
        atexit.register(self._finish, process, own)
        return own

    def _finish(self, process: subprocess.Popen[bytes], line: socket.socket) -> None:
        line.close()
        process.wait()


# -- in the nursery ----------------------------------------------------------------------------------------------------


def _learn() -> None:
    """Import what serving imports, and settle it in memory: none of it is to be copied in every child."""
    import uvicorn.loops.auto
    import uvicorn.protocols.http.auto  # noqa: F401

    from protocols import registry

    registry.warm()
    gc.collect()
    gc.freeze()


def _forking(line: socket.socket) -> list[str] | None:
    """Fork for every request; returns in each child, with the words of its command line, and at the end, with None."""
    ends: dict[int, int] = {}

    def reap(*_: object) -> None:
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                end = ends.pop(found[0])
                with contextlib.suppress(OSError):  # nobody asks any more
                    os.write(end, str(os.waitstatus_to_exitcode(found[1])).encode())
                os.close(end)

    signal.signal(signal.SIGCHLD, reap)
    while True:
        asked, given, _, _ = socket.recv_fds(line, 1 << 20, 2)
        if not asked:
            return None
        out, end = given
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # not before it is known whose end it is
        nursery, pid = os.getpid(), os.fork()
        if pid == 0:
            for one in (line.detach(), end, *ends.values()):
                os.close(one)
            request = json.loads(asked)
            _settle(nursery, request["env"], out)
            return list(request["argv"])
        ends[pid] = end
        os.close(out)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
        line.send(str(pid).encode())


def _settle(nursery: int, env: dict[str, str], out: int) -> None:
    """A child's own place: session, signals, environment, and where it prints. It ends with its nursery."""
    os.setsid()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))
    if os.getppid() != nursery:
        sys.exit("who asked for this has ended")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.close(out)
    os.environ.clear()
    os.environ.update(env)


def _main(line: socket.socket) -> int:
    _learn()
    words = _forking(line)
    if words is None:
        return 0
    from server.cli import main

    sys.argv = ["imuscope", *words]
    return main(words)


if __name__ == "__main__":
    sys.exit(_main(socket.socket(fileno=int(sys.argv[1]))))
