"""Long fuzzing of external inputs: the HTTP API, the WebSockets, files. See http.py, ws.py, files.py.

    python -m tests.fuzz http --minutes 10        findings/http/*.json
    python -m tests.fuzz ws --minutes 10          findings/ws/*.json
    python -m tests.fuzz files --minutes 10       findings/files/*.hex

Of each way to break, told by where and how, the first is kept; the others are counted.
"""

from __future__ import annotations

import contextlib
import faulthandler
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.fuzz import cases, files, http, ws
from tests.fuzz.cases import BrokenError

A_ROUND = 6  # requests of each operation, right ones and wrong ones
TALKS = 20


class ExternalRun:
    """One run.

    Args:
        name: http, ws or files.
        first: the seed.
    """

    def __init__(self, name: str, first: int) -> None:
        self.name = name
        self.first = first
        self.cases = 0
        self.kinds: Counter[str] = Counter()

    def run(self, seconds: float) -> None:
        """Run until the time is over; a round is completed."""
        steps: Callable[[Path], Iterator[None]] = {"http": self._http, "ws": self._ws, "files": self._files}[self.name]
        begin = shown = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            for _ in steps(Path(folder)):
                now = time.monotonic()
                if now - begin > seconds:
                    break
                if now - shown > 30:
                    shown = now
                    print(f"{now - begin:6.0f} s  {self.cases} cases  broken {dict(self.kinds)}", flush=True)
        print(f"{time.monotonic() - begin:6.0f} s  {self.cases} cases  broken {dict(self.kinds)}", flush=True)

    def _http(self, folder: Path) -> Iterator[None]:
        with http.FuzzedServer(folder) as server:
            search = http.RequestSearch(server, self.first)
            while True:
                for request, broken in search.step(A_ROUND, slow=search.round == 1):
                    self.cases = search.cases
                    way = f"{request.method} {request.path.partition('?')[0]} {broken.kind}"
                    self._broke(way, broken, lambda name, words, request=request: request.write(name, words))
                    yield
                self.cases = search.cases
                yield

    def _ws(self, folder: Path) -> Iterator[None]:
        with http.FuzzedServer(folder) as server:
            floor, turn = ws.Floor(server), 0
            while True:
                turn += 1
                for talk, broken in ws.talks(floor, 1000 * self.first + turn, TALKS):
                    way = f"{talk.path} {broken.kind}"
                    self._broke(way, broken, lambda name, words, talk=talk: talk.write(name, words))
                self.cases = floor.talks
                yield

    def _files(self, folder: Path) -> Iterator[None]:
        search = files.FileSearch(folder, self.first)
        assert search.reading  # it starts before memory is limited
        with files.bounded(), contextlib.closing(search):
            while True:
                case = search.case()
                faulthandler.dump_traceback_later(files.PATIENCE_S, exit=True)
                try:
                    search.check(case)
                except BrokenError as broken:
                    faulthandler.cancel_dump_traceback_later()  # to make it smaller takes many attempts
                    way = f"{case.settings['kind']} {broken.kind}"
                    if not self.kinds[way]:
                        case, broken = search.smaller(case, broken)
                    about = f"{broken.kind} · seed {self.first} · case {search.cases}"
                    self._broke(
                        way,
                        broken,
                        lambda name, words, case=case, about=about: cases.write("files", case, words, about, name),
                    )
                faulthandler.cancel_dump_traceback_later()
                self.cases = search.cases
                yield

    def _broke(self, way: str, broken: BrokenError, keep: Callable[[str, str], Path]) -> None:
        self.kinds[way] += 1
        if self.kinds[way] == 1:
            name = "".join(char if char.isalnum() else "-" for char in f"{broken.kind}-{self.first}-{self.cases}")
            path = keep(name, " ".join(str(broken).split())[:400])
            print(f"\n{path}\n  {way}: {str(broken)[:1500]}", flush=True)
