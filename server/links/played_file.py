"""A file that is played, read in a process of its own (played_file_worker.py): a Source (recordings/sources.py).

    PlayedFile ── a line of JSON for each pass ──> worker ── blocks of bytes ──> ReplayClock

Whatever the file was made to do happens to that process, which has limits and ends with the link. The bytes go over a
socket that only the playing thread reads.
"""

import contextlib
import json
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice
from imuscope.recordings.system.resource_limits import seconds_for
from imuscope.server.system.workers import Worker

MODULE = "imuscope.server.library.played_file_worker"
OPENING_SHARE = 4  # opening may take so many times the processor time that it may take
MALICIOUS = "The file may be damaged or malicious."


class PlayedFile:
    """A file, opened by `open`; `end` ends its process.

    Attributes:
        span: times of its first and last chunk, ns; None if it has none.
    """

    timed = True
    header: Mapping[str, str] = {}

    def __init__(self, path: Path, worker: Worker, line: socket.socket) -> None:
        self.path = path
        self._worker, self._line = worker, line
        self._received = line.makefile("rb")
        self._pass = 0
        self.format = ""
        self.devices: dict[str, SourceDevice] = {}
        self.damage: list[FileDamage] = []
        self.span: tuple[int, int] | None = None
        self._preambles: Mapping[str, str] = {}

    @classmethod
    async def start(cls, path: Path) -> "PlayedFile":
        """Start the process. OSError: it cannot be started."""
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                worker = await Worker.start(MODULE, control=theirs.fileno())
            except BaseException:
                ours.close()
                raise
        return cls(path, worker, ours)

    def open(self, protocol: str = "") -> None:
        """Open the file. Call it in a thread.

        Raises:
            RecordingError: it cannot be read.
        """
        try:
            size = self.path.stat().st_size
        except OSError:
            size = 0
        self._line.settimeout(OPENING_SHARE * seconds_for(size))
        head = self._requested({"path": str(self.path), "protocol": protocol})
        self._line.settimeout(None)
        self.format = head["format"]
        self.devices = {one["id"]: SourceDevice(one["id"], one["protocol"], one["identity"]) for one in head["devices"]}
        self.damage = [FileDamage(-1, words) for words in head["damage"]]
        self.span = (head["span"][0], head["span"][1]) if head["span"] is not None else None
        self._preambles = head["preambles"]

    def preamble(self, device: str) -> bytes:
        """Definitions of the channels of a device that sends messages."""
        return bytes.fromhex(self._preambles.get(device, ""))

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """As Source.parts. RecordingError: the file cannot be read any more."""
        self._pass += 1
        head = self._requested({"pass": self._pass, "start": start_ns, "stop": stop_ns})
        while not head.get("is_last"):
            size, count = head["size"], head["count"]
            data = self._read(size)
            ends, times = (np.frombuffer(self._read(8 * count), np.int64) for _ in range(2))
            yield ChunkBlock(head["device"], head["direction"], data, ends, times, head["done"])
            head = self._next()

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Not played: none."""
        return iter(())

    def _requested(self, request: Mapping[str, object]) -> dict[str, Any]:
        try:
            self._line.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            raise self._lost() from None
        return self._next()

    def _next(self) -> dict[str, Any]:
        """The next head of this pass; blocks of an earlier one are left out."""
        while True:
            try:
                text = self._received.readline()
            except OSError:
                text = b""
            if not text.endswith(b"\n"):
                raise self._lost()
            head: dict[str, Any] = json.loads(text)
            if "message" in head:
                raise RecordingError(head["message"], head["hint"])
            if head.get("pass", self._pass) == self._pass:
                return head
            self._read(head.get("size", 0) + 16 * head.get("count", 0))

    def _read(self, size: int) -> bytes:
        try:
            data = self._received.read(size)
        except OSError:
            data = b""
        if len(data) < size:
            raise self._lost()
        return data

    def _lost(self) -> RecordingError:
        return RecordingError(f"Reading {self.path.name} ended its process, or takes too long.", MALICIOUS)

    def cut(self) -> None:
        """Let a thread that waits for bytes go on: it gets a RecordingError."""
        with contextlib.suppress(OSError):
            self._line.shutdown(socket.SHUT_RDWR)

    async def end(self) -> None:
        self.cut()
        self._received.close()
        self._line.close()
        await self._worker.end()
