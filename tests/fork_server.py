"""Fork server: servers for tests without the CPU time of each start. Forks a process that has already started.

    test process ── socket pair ──> nursery: has imported the server, opened and served nothing; one thread
         │                             │ fork, for every command line that is asked for
         │  files, pipes               ▼
         └────────────────────────── `server.cli.main([...])`, in a session of its own

What runs from there on is what `imuscope …` runs. What an import may leave behind in one process is not seen this way,
and neither is the command line in the process's title: tests of these, and of the start, ask for a start of their own
(tests/server_process.py, `fresh`), which is also what every benchmark gets, and every system but Linux.

A request is one message: JSON {argv, env}, with four descriptors: standard input, output and error, and where to tell
the end (its status as subprocess has it: negative for a signal). The answer is the process's id. The nursery ends when
the test process does, and what it has forked with the nursery.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import IO, NoReturn

ROOT = Path(__file__).resolve().parent.parent
PR_SET_PDEATHSIG = 1  # prctl(2)
IS_THERE = sys.platform == "linux"
LEARNT = (
    *("server.app", "server.commands.serve", "server.links.simulator", "protocols.simulator.trajectory"),
    *("uvicorn.loops.auto", "uvicorn.protocols.http.auto", "uvicorn.lifespan.on", "anyio._backends._asyncio"),
)


class Child:
    """A forked command, with as much of `subprocess.Popen` as tests use."""

    def __init__(self, pid: int, command: Sequence[str], end: socket.socket) -> None:
        self.pid = pid
        self.args = command
        self.stdout: IO[str] | None = None
        self.stderr: IO[str] | None = None
        self.returncode: int | None = None
        self._end = end
        self._lock = threading.Lock()

    def poll(self) -> int | None:
        """Its exit status, or None while it runs."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.wait(0)
        return None

    def wait(self, timeout: float | None = None) -> int:
        """Exit status of the process.

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

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Remaining output and error output (at most a pipe's capacity), up to the end of the process."""
        said = tuple(stream.read() if stream else "" for stream in (self.stdout, self.stderr))
        self.wait(timeout)
        for stream in (self.stdout, self.stderr):
            if stream:
                stream.close()
        return said[0], said[1]

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended. Its end may be on its way here, when there is nothing left to signal."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """The forking process, started with the first server."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._line: socket.socket | None = None

    def start(self, arguments: Sequence[str], given: int, out: int, err: int) -> Child:
        """`imuscope ARGUMENTS`, running; `given`, `out` and `err` are its standard streams, and stay the caller's."""
        with self._lock:
            if self._line is None:
                self._line = self._begin()
            end, other = socket.socketpair()
            with other:
                request = json.dumps({"argv": [*arguments], "env": {**os.environ, "PYTHONUNBUFFERED": "1"}}).encode()
                socket.send_fds(self._line, [request], [given, out, err, other.fileno()])
            try:
                pid = int(self._line.recv(16))
            except (OSError, ValueError):
                end.close()
                raise RuntimeError("the process that forks has ended: see what it printed") from None
        return Child(pid, arguments, end)

    def _begin(self) -> socket.socket:
        own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.fork_server", str(other.fileno())],
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
    from server.commands.common import prepare_decoders

    prepare_decoders(ROOT / "artifacts")  # first, because it sets the folder of compiled code
    for name in LEARNT:
        importlib.import_module(name)
    importlib.import_module("server.library.sources").decoding_mark()  # of the sources as they are now
    gc.collect()
    gc.freeze()


def _forking(line: socket.socket) -> list[str] | None:
    """Fork for every request; returns in each child, with the words of its command line, and at the end, with None."""
    ends: dict[int, int] = {}

    def reap(*_: object) -> None:
        with contextlib.suppress(ChildProcessError):
            while (found := os.waitpid(-1, os.WNOHANG))[0]:
                end = ends.pop(found[0])
                with contextlib.suppress(OSError):  # the test process has ended
                    os.write(end, str(os.waitstatus_to_exitcode(found[1])).encode())
                os.close(end)

    signal.signal(signal.SIGCHLD, reap)
    while True:
        asked, given, _, _ = socket.recv_fds(line, 1 << 20, 4)
        if not asked:
            return None
        *streams, end = given
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # after its process id is known
        nursery, pid = os.getpid(), os.fork()
        if pid == 0:
            for one in (line.detach(), end, *ends.values()):
                os.close(one)
            request = json.loads(asked)
            _settle(nursery, request["env"], streams)
            return list(request["argv"])
        ends[pid] = end
        for one in streams:
            os.close(one)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
        line.send(str(pid).encode())


def _settle(nursery: int, env: dict[str, str], streams: Sequence[int]) -> None:
    """A child's own place: session, signals, environment, standard streams. It ends with its nursery."""
    os.setsid()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))
    if os.getppid() != nursery:
        sys.exit("who asked for this has ended")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
    for number, one in enumerate(streams):
        os.dup2(one, number)
        os.close(one)
    os.environ.clear()
    os.environ.update(env)


def _run(words: list[str]) -> int:
    """Run a command line; its exit status, as the interpreter has it."""
    from server.cli import main

    sys.argv = ["imuscope", *words]
    try:
        return main(words)
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            return ended.code or 0
        print(ended.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    return 1


def _end(status: int) -> NoReturn:
    """End a child as the interpreter does, but leave its memory to the system. To free what was imported would copy
    all of it first, which took most of the time of a short command.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    try:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    except OSError:
        status = 120
    os._exit(status)


def _main(line: socket.socket) -> int:
    _learn()
    words = _forking(line)
    if words is not None:
        _end(_run(words))
    return 0


if __name__ == "__main__":
    sys.exit(_main(socket.socket(fileno=int(sys.argv[1]))))
