"""Fork server: servers for tests without the CPU time of each start. Forks a process that has already started.

    test processes ── a socket each ──> nursery: has imported the server, opened and served nothing; one thread
         │                                │ fork, for every command line that is asked for
         │  files, pipes                  ▼
         └───────────────────────────── `imuscope.server.cli.main([...])`, in a session of its own

What runs from there on is what `imuscope …` runs. What an import may leave behind in one process is not seen this way,
and neither is the command line in the process's title: tests of these, and of the start, ask for a start of their own
(tests/support/server_process.py, `fresh`), which is also what every benchmark gets, and every system but Linux.

A request is one message: JSON {argv, env}, with four descriptors: standard input, output and error, and where to tell
the end: its status as subprocess has it (negative for a signal), and its processor time. The answer is the process's
id. What was forked for a test process ends with it.

The workers of one run of pytest have one nursery, because its imports take as long as twenty servers: the process that
distributes tests names a socket in the environment (`share`). It imports when the first of them connects, and ends with
the process that started it.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import json
import os
import runpy
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, NoReturn

from tests.support.forking.nursery_modules import HEAVY, LEARNT, WORKERS, worker_name

ROOT = Path(__file__).resolve().parents[3]
PR_SET_PDEATHSIG = 1  # prctl(2)
IS_THERE = sys.platform == "linux"
VARIABLE = "IMUSCOPE_TEST_NURSERY"  # path of the socket of a nursery that is shared
CONNECTIONS = 100


class Child:
    """A forked command, with as much of `subprocess.Popen` as tests use.

    Attributes:
        processor_s: processor time it took, with the processes that it waited for; 0 while it runs.
    """

    def __init__(self, pid: int, command: Sequence[str], end: socket.socket) -> None:
        self.pid = pid
        self.args = command
        self.stdout: IO[str] | None = None
        self.stderr: IO[str] | None = None
        self.returncode: int | None = None
        self.processor_s = 0.0
        self._end = end
        self._lock = threading.Lock()

    def fileno(self) -> int:
        """A descriptor that is readable when it has ended."""
        return self._end.fileno()

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
                report = self._end.recv(64).split()
                self.returncode = int(report[0]) if report else -signal.SIGKILL  # with the nursery, if that was killed
                self.processor_s = float(report[1]) if report else 0.0
                self._end.close()
            return self.returncode

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Remaining output and error output (at most a pipe's capacity), up to the end of the process."""
        texts = tuple(stream.read() if stream else "" for stream in (self.stdout, self.stderr))
        self.wait(timeout)
        for stream in (self.stdout, self.stderr):
            if stream:
                stream.close()
        return texts[0], texts[1]

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
    """Client of a nursery.

    Args:
        address: of a nursery that is there; "" starts one with the first command.

    Attributes:
        children: all that were begun in a nursery that is there, whose processor time is not this process's.
    """

    def __init__(self, address: str = "") -> None:
        self._address = address
        self.children: list[Child] = []
        self._lock = threading.Lock()
        self._line: socket.socket | None = None

    def start(self, arguments: Sequence[str], source: int, out: int, err: int, *, module: str = "") -> Child:
        """`imuscope ARGUMENTS`, or `python -m module ARGUMENTS`, running.

        Args:
            given, out, err: its standard streams, which stay the caller's.
        """
        with self._lock:
            if self._line is None:
                self._line = _connected(self._address or _begin())
                atexit.register(self._line.close)
            end, other = socket.socketpair()
            with other:
                env = {**os.environ, "PYTHONUNBUFFERED": "1"}
                request = json.dumps({"argv": [*arguments], "env": env, "module": module}).encode()
                socket.send_fds(self._line, [request], [source, out, err, other.fileno()])
            try:
                pid = int(self._line.recv(16))
            except (OSError, ValueError):
                end.close()
                raise RuntimeError("the process that forks has ended: see what it printed") from None
        child = Child(pid, arguments, end)
        if self._address:
            self.children.append(child)
        return child


def share() -> None:
    """Start a nursery for this process and those that it starts from now on."""
    os.environ[VARIABLE] = _begin()


def _connected(address: str) -> socket.socket:
    line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    line.connect(address)
    return line


def _begin() -> str:
    """Start a nursery that ends with this process. Returns its address."""
    folder = tempfile.mkdtemp(prefix="imuscope-nursery-")  # nobody else may connect
    own, other = socket.socketpair()
    with other, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(address := f"{folder}/nursery")
        listener.listen(CONNECTIONS)
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.support.forking.fork_server", str(listener.fileno()), str(other.fileno())],
            cwd=ROOT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            pass_fds=[listener.fileno(), other.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    atexit.register(_finish, process, own, folder)
    return address


def _finish(process: subprocess.Popen[bytes], owner: socket.socket, folder: str) -> None:
    owner.close()
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


# -- in the nursery ----------------------------------------------------------------------------------------------------


def _learn_to_serve() -> None:
    """Import what serving imports."""
    importlib.import_module(
        "imuscope.server.library.decoder_fingerprint"
    ).decoding_mark()  # of the sources as they are now
    for name in WORKERS:
        with contextlib.suppress(ModuleNotFoundError):  # an installation without the packages of an extension
            importlib.import_module(name)
    importlib.import_module("imuscope.server.services.extension").extension_problems()
    importlib.import_module("imuscope.server.links.registry").link_kinds()
    own = [one for one in importlib.import_module("imuscope.server.services.extension").extensions() if not one.package]
    _learn(*LEARNT, *(name for one in own for name in (one.parts, *one.routes) if name))


def _learn(*modules: str) -> None:
    """Import modules, and settle them in memory: none of it is to be copied in every child."""
    for name in modules:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()


@dataclass(frozen=True)
class _Request:
    """What a child does.

    Attributes:
        words: arguments.
        module: runs; "" for the command line.
        nursery: address of the nursery.
    """

    words: list[str]
    module: str
    nursery: str


def _peer(line: socket.socket) -> int:
    """The process at the other end: SO_PEERCRED, unix(7)."""
    pid: int
    pid, _, _ = struct.unpack("3i", line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return pid


class _Nursery:
    """Forks for every request of every test process.

    Args:
        listener: test processes connect to it.
        owner: at its end the process that started the nursery has ended.
    """

    def __init__(self, listener: socket.socket, owner: socket.socket) -> None:
        self._listener = listener
        self._listener_name: str = listener.getsockname()
        self._owner = owner
        self._ends: dict[int, int] = {}
        self._children: dict[socket.socket, set[int]] = {}  # by the connection of who asked for them
        self._requested_by: dict[int, int] = {}  # child -> process
        self._spent_s: dict[int, float] = {}  # process -> processor time of what was forked for it
        self._learnt: set[str] = set()  # of HEAVY

    def run(self) -> _Request | None:
        """Returns in each child, with what it is asked to do, and at the end, with None."""
        signal.signal(signal.SIGCHLD, self._reap)
        is_ready = False
        while True:
            readable = select.select([self._owner, self._listener, *self._children], [], [])[0]
            if self._owner in readable:
                return None
            for one in readable:
                if one is self._listener:
                    if not is_ready:
                        _learn_to_serve()
                        is_ready = True
                    self._children[self._listener.accept()[0]] = set()
                elif (request := self._answer(one)) is not None:
                    return request

    def _answer(self, line: socket.socket) -> _Request | None:
        """Fork once; in the child, what it is asked to do."""
        try:
            question, source, _, _ = socket.recv_fds(line, 1 << 20, 4)
        except OSError:
            question, source = b"", []
        if not question:
            line.close()
            for pid in self._children.pop(line):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGTERM)
            return None
        *streams, end = source
        module = json.loads(question)["module"]
        if module in HEAVY and module not in self._learnt:
            self._learnt.add(module)
            _learn(module, *HEAVY[module])
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # after its process id is known
        requested_by = _peer(line)
        nursery, pid = os.getpid(), os.fork()
        if pid == 0:
            for one in (self._listener, self._owner, *self._children):
                one.close()
            for descriptor in (end, *self._ends.values()):
                os.close(descriptor)
            request = json.loads(question)
            if module:
                Path("/proc/self/comm").write_text(worker_name(module, requested_by))
            _settle(nursery, request["env"], streams)
            return _Request(request["argv"], request["module"], self._listener_name)
        self._ends[pid] = end
        self._requested_by[pid] = requested_by
        self._children[line].add(pid)
        for descriptor in streams:
            os.close(descriptor)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
        with contextlib.suppress(OSError):  # the test process has ended: seen with the next message
            line.send(str(pid).encode())
        return None

    def _reap(self, *_: object) -> None:
        with contextlib.suppress(ChildProcessError):
            while (result := os.wait4(-1, os.WNOHANG))[0]:
                pid, status, usage = result
                for those in self._children.values():
                    those.discard(pid)
                end = self._ends.pop(pid)
                with contextlib.suppress(OSError):  # the test process has ended
                    spent_s = usage.ru_utime + usage.ru_stime + self._spent_s.pop(pid, 0.0)
                    requested_by = self._requested_by.pop(pid)
                    self._spent_s[requested_by] = self._spent_s.get(requested_by, 0.0) + spent_s
                    os.write(end, f"{os.waitstatus_to_exitcode(status)} {spent_s:.3f}".encode())
                os.close(end)


def _settle(nursery: int, env: dict[str, str], streams: Sequence[int]) -> None:
    """A child's own place: session, signals, environment, standard streams. It ends with its nursery."""
    os.setsid()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))
    if os.getppid() != nursery:
        sys.exit("who asked for this has ended")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where a script runs them in the background
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
    for number, one in enumerate(streams):
        os.dup2(one, number)
        os.close(one)
    os.environ.clear()
    os.environ.update(env)


def _run(request: _Request) -> int:
    """Run a command line or a module; its exit status, as the interpreter has it."""
    from imuscope.server.cli import main
    from tests.support.forking.forked_workers import install

    install(ForkServer(request.nursery))
    sys.argv = [request.module or "imuscope", *request.words]
    try:
        if not request.module:
            return main(request.words)
        os.nice = lambda _: 0  # a worker that lets all others go first would last for minutes on a busy machine
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # it has been imported
            runpy.run_module(request.module, run_name="__main__")
        return 0
    except SystemExit as ended:
        if ended.code is None or isinstance(ended.code, int):
            return ended.code or 0
        print(ended.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    return 1


def end(status: int) -> NoReturn:
    """End this process as the interpreter does, but leave its memory to the system.

    To free what was imported would copy all of it first, which took most of the time of a short command.
    """
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    try:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
    except OSError:
        status = 120
    os._exit(status)


def _main(listener: socket.socket, owner: socket.socket) -> NoReturn:
    request = _Nursery(listener, owner).run()
    end(0 if request is None else _run(request))


if __name__ == "__main__":
    _main(*(socket.socket(fileno=int(word)) for word in sys.argv[1:]))
