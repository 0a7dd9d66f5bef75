"""The table of where the check's time goes, in CONTRIBUTING.md: `tests/check.py --profile` writes it."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tests.support.source_files import ROOT

BEGIN, END = "<!-- time table: tests/check.py --profile -->", "<!-- end of the time table -->"
MAX_FILES = 8  # files of tests that are named
PAGE = ROOT / "CONTRIBUTING.md"


@dataclass
class Spent:
    """Seconds of some tests."""

    tests: int = 0
    set_up: float = 0.0
    call: float = 0.0
    tear_down: float = 0.0
    own: float = 0.0
    begun: float = 0.0
    browser: float = 0.0

    @property
    def processor(self) -> float:
        return self.own + self.begun + self.browser

    @property
    def waiting(self) -> float:
        """Time that passed while pytest's own process did nothing."""
        return max(0.0, self.set_up + self.call + self.tear_down - self.own)

    def add(self, line: dict[str, float]) -> None:
        self.tests += 1
        self.set_up += line.get("setup", 0.0)
        self.call += line.get("call", 0.0)
        self.tear_down += line.get("teardown", 0.0)
        self.own += line["own"]
        self.begun += line["begun"]
        self.browser += line["browser"]


@dataclass
class Profile:
    """What the processes of pytest wrote (time_profile.py)."""

    starts: list[float] = field(default_factory=list)
    files: dict[str, Spent] = field(default_factory=lambda: defaultdict(Spent))

    @classmethod
    def read(cls, folder: Path) -> Profile:
        result = cls()
        for path in sorted(folder.glob("*.jsonl")):
            for line in map(json.loads, path.read_text().splitlines()):
                if line.get("start"):
                    result.starts.append(line["own"] + line["begun"] + line["browser"])
                else:
                    result.files[line["test"].split("::")[0]].add(line)
        return result

    def folders(self) -> dict[str, Spent]:
        """Sums by folder of tests/, and by extension, the most processor time first."""
        sums: dict[str, Spent] = defaultdict(Spent)
        for name, spent in self.files.items():
            parts = Path(name).parent.parts
            one = sums["/".join(parts[: 4 if parts[2:3] == ("extensions",) else 2]) or "."]
            for key, value in vars(spent).items():
                setattr(one, key, getattr(one, key) + value)
        return dict(sorted(sums.items(), key=lambda item: -item[1].processor))

    def seconds(self) -> dict[str, float]:
        """Seconds that each file took."""
        return {name: round(one.set_up + one.call + one.tear_down, 2) for name, one in self.files.items()}


@dataclass(frozen=True)
class PartTime:
    """A part of the check: seconds that passed, and of a processor."""

    name: str
    passed: float
    processor: float


def table(parts: Sequence[PartTime], profile: Profile, *, passed: float, memory: int, date: str, machine: str) -> str:
    """The table as Markdown."""
    total = sum(part.processor for part in parts)
    lines = [
        f"Measured on {date} on {machine}: {passed:.0f} s, {total:.0f} s of a processor, at most "
        f"{memory / 1e9:.1f} GB of memory. A second run, with compiled code, caches and Chromium there.",
        "",
        "| part | passed, s | processor, s |",
        "|---|---|---|",
        *(f"| {part.name} | {part.passed:.0f} | {part.processor:.0f} |" for part in parts),
        "",
        f"Of pytest: {sum(profile.starts):.0f} s of a processor to import, to collect and to load compiled code, once "
        "for all workers. The tests themselves, in seconds:",
        "",
        "| folder | tests | set-up | call | tear-down | waiting | processor: pytest | begun by it | Chromium |",
        "|---|---|---|---|---|---|---|---|---|",
        *(_row(name, spent) for name, spent in profile.folders().items()),
        "",
        "The files that take the most of a processor:",
        "",
        "| file | tests | set-up | call | tear-down | waiting | processor: pytest | begun by it | Chromium |",
        "|---|---|---|---|---|---|---|---|---|",
        *(_row(name, one) for name, one in sorted(profile.files.items(), key=lambda i: -i[1].processor)[:MAX_FILES]),
    ]
    return "\n".join(lines)


def _row(name: str, spent: Spent) -> str:
    figures = (spent.set_up, spent.call, spent.tear_down, spent.waiting, spent.own, spent.begun, spent.browser)
    return f"| {name} | {spent.tests} | " + " | ".join(f"{one:.0f}" for one in figures) + " |"


def write(text: str, page: Path = PAGE) -> None:
    """Replace the table in CONTRIBUTING.md."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    page.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")
