"""The search: selection of the next case, and reduction of a failing one.

A step takes an entry of the corpus (often one of the newest), joins it with parts of others, spoils it, and checks it.
All that is random comes from one generator, so a seed gives the same steps everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from tests.fuzz.cases import BrokenError, Case
from tests.fuzz.invariants import Features, check
from tests.fuzz.mutations import Pieces, spoil
from tests.fuzz.targets import TARGETS

_MAX_BYTES = 4000
_MAX_BYTES_SOMETIMES = 20_000
_MAX_CORPUS = 3000
_GUESS_EVERY = 25


class CorpusSearch:
    """One target with its corpus.

    Args:
        captures: start from recordings beside the project too, if there are any.

    Attributes:
        cases, bytes, frames: counts so far.
        seen: features found so far.
    """

    def __init__(self, protocol: str, seed: int, *, captures: bool = True) -> None:
        self.target = TARGETS[protocol]
        self.random = Random(f"{protocol} {seed}")
        self.corpus: list[Pieces] = self.target.seeds(captures=captures)
        self.visited: set[tuple[object, ...]] = set()
        self.cases = self.bytes = self.frames = 0

    def step(self) -> tuple[Case, BrokenError] | None:
        """Check one case more. Returns it where it broke something."""
        pieces = self._pieces()
        case = self._case(pieces)
        self.cases += 1
        self.bytes += len(case.data)
        try:
            shown = check(self.target.speaker, case, guessing=self.cases % _GUESS_EVERY == 0)
        except BrokenError as broken:
            return case, broken
        self.frames += len(pieces)
        self._learn(pieces, shown)
        return None

    def _pieces(self) -> Pieces:
        random, corpus = self.random, self.corpus
        recent = random.random() < 0.4
        entry = corpus[random.randrange(max(0, len(corpus) - 100) if recent else 0, len(corpus))]
        pieces = list(entry)
        for _ in range(random.choice((0, 0, 1, 2))):
            other = random.choice(corpus)
            if other:
                start = random.randrange(len(other))
                pieces[random.randint(0, len(pieces)) : 0] = other[start : start + random.randint(1, 4)]
        spoil(pieces, self.target, random)
        most = _MAX_BYTES_SOMETIMES if random.random() < 0.03 else _MAX_BYTES
        while len(pieces) > 1 and sum(map(len, pieces)) > most:
            del pieces[random.randrange(len(pieces))]
        return pieces

    def _case(self, pieces: Pieces) -> Case:
        random = self.random
        data = b"".join(pieces)[:_MAX_BYTES_SOMETIMES]
        style = random.random()
        count = 1 if style < 0.3 else random.randint(2, 12) if style < 0.8 else min(len(data), 80)
        if style > 0.97 and len(data) < 600:
            cuts = tuple(range(1, len(data)))  # one byte at a time
        else:
            cuts = tuple(sorted(random.randrange(len(data) + 1) for _ in range(count)))
        return Case(data, cuts, self.target.settings(random))

    def _learn(self, pieces: Pieces, shown: Features) -> None:
        if shown <= self.visited:
            return
        self.visited |= shown
        if len(self.corpus) >= _MAX_CORPUS:
            del self.corpus[self.random.randrange(len(self.corpus))]
        self.corpus.append(pieces)


class Smallest:
    """The smallest case so far that breaks an invariant, and how.

    Args:
        check: raises BrokenError.
        attempts: at most so many cases are checked.
    """

    def __init__(self, check: Callable[[Case], object], case: Case, broken: BrokenError, attempts: int) -> None:
        self.case, self.broken = case, broken
        self._check, self._left = check, attempts

    def take(self, smaller: Case) -> bool:
        """Go on from a smaller case if it breaks the same invariant."""
        if self._left <= 0:
            return False
        self._left -= 1
        try:
            self._check(smaller)
        except BrokenError as broken:
            if broken.kind == self.broken.kind:
                self.case, self.broken = smaller, broken
                return True
        return False

    def shorten(self) -> None:
        """Leave out ever shorter stretches of bytes that it can do without."""
        size = max(len(self.case.data) // 2, 1)
        while size >= 1 and self._left > 0:
            shrunk = self._leave_out(size)
            size = size if shrunk and size < len(self.case.data) else size // 2

    def _leave_out(self, size: int) -> bool:
        shrunk = False
        at = 0
        while at < len(self.case.data) and self._left > 0:
            case = self.case
            cuts = tuple(cut if cut <= at else max(at, cut - size) for cut in case.cuts)
            if self.take(Case(case.data[:at] + case.data[at + size :], cuts, case.settings)):
                shrunk = True
            else:
                at += size
        return shrunk


def minimised(protocol: str, case: Case, broken: BrokenError, *, attempts: int = 1500) -> tuple[Case, BrokenError]:
    """A smaller case that breaks the same invariant: fewer bytes, cuts and settings."""
    speaker = TARGETS[protocol].speaker
    results = Smallest(lambda one: check(speaker, one, guessing=broken.kind == "guess"), case, broken, attempts)
    if case.settings:
        results.take(Case(case.data, case.cuts))
    results.shorten()
    for cut in results.case.cuts:
        results.take(Case(results.case.data, tuple(at for at in results.case.cuts if at != cut), results.case.settings))
    return results.case, results.broken
