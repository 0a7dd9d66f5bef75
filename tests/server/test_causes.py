"""Causes of what is wrong with a stream: a sentence states one only if something measured it, else it says "may".

Each row of CAUSES has a stream in which the sentence is true, and one that looks alike but has another cause.
"""

import ast
import re
from collections.abc import Awaitable, Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.idtp.frames import build as idtp
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.links.base import LinkError, LinkSettings
from imuscope.server.links.udp import UdpLink
from tests.server.devices.session_harness import SessionHarness, started
from tests.support.each_row import each_row
from tests.support.fakes import FakeClock
from tests.support.source_files import ROOT, facts_of, python_files, tree_of
from tests.support.truth_frames import xbus


class Line(SessionHarness):
    """A session on a link of some kind, and what it says about a stream."""

    def __init__(self, kind: str = "serial", protocol: str = "xbus", sys_root: Path | None = None) -> None:
        super().__init__(all_protocols(), DecodeOptions(protocol))
        self.link.kind, self.link.lost = kind, 0
        if sys_root is not None:
            self.link.place, self.link.settings = "/dev/ttyUSB0", replace(self.link.settings, sys_root=sys_root)
        if kind != "serial":
            self.link.baud = self.link.capacity = None
        self.texts: list[str] = []

    async def play(self, deliveries: Iterable["Delivery"], *, asleep: tuple[float, float] = (0.0, 0.0)) -> None:
        """Deliver bytes at these times, s; the server ticks each tenth of a second unless it is asleep."""
        tick = (self.clock.ns - self.began) / 1e9
        for at, data in sorted(deliveries, key=lambda one: one[0]):
            while tick + 0.1 <= at:
                tick += 0.1
                if not asleep[0] < tick < asleep[1]:
                    self.clock.ns = self.began + round(tick * 1e9)
                    self.session.access.decode()
                    self.session.tick(self.clock())
                    self._listen()
            self.clock.ns = self.began + round(at * 1e9)
            if isinstance(data, bytes):
                await self.receive(data)
            else:
                data(self)
        await self.settle(1.5)
        self._listen()

    def _listen(self) -> None:
        cause, info = self.health.jitter_cause, self.info
        self.texts += [cause.text, cause.remedy] if cause is not None else []
        self.texts += [self.health.time_presumes, info.message, info.hint, *info.notices]

    @property
    def words(self) -> set[str]:
        return {*self.texts, *(event.text for event in self.telemetry.log)} - {""}


Delivery = tuple[float, bytes | Callable[[Line], None]]
Played = Callable[[Path], Awaitable[set[str]]]


def frames(seconds: float, *, rate: float = 100.0, first: int = 0, at: float = 0.05, **more: Any) -> list[Delivery]:
    """Frames of a device that samples evenly, each delivered when it is complete; `first`: the number of the first."""
    return [(at + k / rate, frame(first + k, (first + k) / rate, **more)) for k in range(round(seconds * rate))]


def frame(number: int, time: float, norm: float = 1.0) -> bytes:
    return xbus(number, round(time * 1e4), (0x2010, "4f", (norm, 0.0, 0.0, 0.0)))


def late(deliveries: list[Delivery], since: float, until: float) -> list[Delivery]:
    """What was due from `since` on comes all at once."""
    return [(max(at, until) if at >= since else at, data) for at, data in deliveries]


def without(deliveries: list[Delivery], first: int, last: int) -> list[Delivery]:
    return [*deliveries[:first], *deliveries[last:]]


def damaged(deliveries: list[Delivery], which: Iterable[int], size: int | None = None) -> list[Delivery]:
    """Frames with a wrong byte, cut to `size`."""
    out = list(deliveries)
    for one in which:
        at, data = out[one]
        assert isinstance(data, bytes)
        out[one] = at, (data[:-1] + bytes((data[-1] ^ 0x55,)))[:size]
    return out


def on(deliveries: Iterable[Delivery], *, asleep: tuple[float, float] = (0.0, 0.0), **line: Any) -> Played:
    """The sentences about these bytes."""

    async def play(_: Path) -> set[str]:
        async with started(Line(**line)) as stage:
            await stage.play(deliveries, asleep=asleep)
            return stage.words

    return play


def with_timer(timer_ms: int, delayed: Callable[[float], float]) -> Played:
    """At a USB adapter with this latency timer."""

    async def play(path: Path) -> set[str]:
        timer = path / "bus/usb-serial/devices/ttyUSB0/latency_timer"
        timer.parent.mkdir(parents=True)
        timer.write_text(str(timer_ms))
        async with started(Line(sys_root=path)) as stage:
            await stage.play([(delayed(at), data) for at, data in frames(3)])
            return stage.words

    return play


def held(at: float, period: float = 0.016) -> float:
    return float(np.ceil(at / period) * period)


def with_drop(count: Callable[[Line], None], until: float, *, kind: str = "serial") -> Played:
    """This host drops something at 2.99 s, and twenty frames are missing just before `until`."""
    stream: list[Delivery] = [one for one in frames(until + 1) if not until - 0.2 < one[0] < until]
    return on([*stream, (2.99, count)], kind=kind)


def stalled(times: Iterable[float]) -> Played:
    """On TCP, with stalls of 0.3 s at these times."""
    stream = frames(max(times) + 2)
    for at in times:
        stream = [(at + 0.3 if at <= when < at + 0.3 else when, data) for when, data in stream]
    return on(stream, kind="tcp")


def away(*, is_down: bool) -> Played:
    """Nothing comes for some seconds, as the link is down, or as the device is silent."""

    async def play(_: Path) -> set[str]:
        async with started(Line()) as stage:
            await stage.play(frames(2))
            if is_down:
                stage.link.die(LinkError("gone", "gone.", "?"))
            await stage.settle(3)
            stage.session.retry()
            await stage.settle()
            await stage.play(frames(1, first=700, at=(stage.clock.ns - stage.began) / 1e9))
            return stage.words

    return play


def numbered(numbers: Iterable[int]) -> Played:
    """IDTP frames with these numbers, 1 ms apart by their clock."""
    sent = [(0.05 + 0.001 * k, idtp(0, bytes(12), sequence=n, timestamp=1000 * n)) for k, n in enumerate(numbers)]
    return on(sent, protocol="idtp")


def answered(*replies: bytes) -> Played:
    """Forty samples are missing after these answers of the device."""
    stream = frames(2)
    return on([*stream[:100], *((stream[99][0] + 0.001, reply) for reply in replies), *stream[140:]])


def notices(lost: int) -> Played:
    """On UDP, where the kernel has dropped so many datagrams."""

    async def read(_: Path) -> set[str]:
        link = UdpLink("udp://:0", LinkSettings(now_ns=FakeClock().now_ns), "", 0)
        link._notice(("127.0.0.1", 1), [], 1)
        link.lost = lost
        return set(link.notices)

    return read


def left_out(stage: Line) -> None:
    stage.link.flow.dropped += 620


def overflowed(stage: Line) -> None:
    stage.link.lost += 20


EVEN, RESTARTED_FRAMES = frames(3), [*frames(2), *frames(1, at=2.06, first=0)]
WAKE_UP = bytes.fromhex("FA FF 3E 00 C3")
LATE = late(frames(4), 2.5, 2.9)
SET_BACK = [
    *frames(2, first=9000),
    *((at, frame(9200 + k, 89 + k / 100)) for k, (at, _) in enumerate(frames(1, at=2.05))),
]
DELAYS = np.random.default_rng(1).exponential(3e-3, 300)
THINNING = [(at + delay, data) for (at, data), delay in zip(EVEN, DELAYS.tolist(), strict=True)]
ONE_CUT = damaged(without(frames(3), 150, 200), [149], 12)
FULL, PEAK = frames(9, rate=330.0), [*frames(6), *late(frames(3, first=600, at=6.05), 6.1, 7.0)]


@dataclass(frozen=True)
class Row:
    """A sentence as the source has it, what must have been measured, a stream in which it is true, and one that looks
    so; whether the sentence is stated in the latter too, as it says "may", and what else is, as a regular expression.
    """

    sentence: str
    measured: str
    true: Played
    alike: Played
    may: bool = False
    instead: str = ""


CAUSES = [
    Row(
        "The device's clock restarted {} in the last minute; the mapping of its times restarts there.",
        "the clock is back at its beginning",
        on(RESTARTED_FRAMES),
        on(SET_BACK),
        instead=r"clock was set back by 3",
    ),
    Row(
        "If it was not restarted on purpose, and nothing set its clock, check its supply and its cable.",
        "the clock is back at its beginning",
        on(RESTARTED_FRAMES),
        on(EVEN),
    ),
    Row(
        "The {} moved together with the clock, so the device restarted: the number of lost samples is not known.",
        "counter and clock, both at the same frame",
        on([*frames(2, first=59_800), *frames(1, at=2.06, first=5)]),
        on([*frames(2), *frames(1, at=2.05, first=200 + 5000)]),
        instead="which is more than the device sends",
    ),
    Row(
        "{}this host did not run the server in that time.",
        "own scheduling: the server did not tick",
        on(LATE, asleep=(2.45, 2.89)),
        on(LATE),
        instead=r"0\.4 s, then all at once: the device, its adapter or this host may have paused",
    ),
    Row(
        "{}the device, its adapter or this host may have paused.",
        "late frames that come all at once",
        on(LATE),
        on(without(frames(4), 250, 290)),
        instead="40 samples lost",
    ),
    Row(
        "{}the network or either end may have paused.",
        "late frames that come all at once, over a network",
        on(LATE, kind="tcp"),
        on(LATE, kind="tcp", asleep=(2.45, 2.89)),
        instead="this host did not run",
    ),
    Row(
        "{}, {} times in the last minute",
        "the time of each stall",
        stalled((2, 4, 6)),
        stalled((2, 64, 126)),
        instead=r"Nothing was read for 0\.\d s, then",
    ),
    Row(
        "Samples arrive unevenly over the network, up to {} ms late.",
        "delays that thin out, on a link that is a network",
        on(THINNING, kind="udp"),
        on(EVEN, kind="udp"),
    ),
    Row(
        "{}: a USB adapter may hold them until {} expires.",
        "delays spread evenly over some ms, and the latency timer where the system states it",
        with_timer(16, held),
        on([(held(at), data) for at, data in EVEN]),  # the device itself may send in bursts
        may=True,
    ),
    Row(
        "{}, although the latency timer of the USB adapter is 1 ms: bytes may be buffered elsewhere.",
        "delays spread evenly over some ms, and the latency timer",
        with_timer(1, held),
        with_timer(1, lambda at: at),
    ),
    Row(
        "The USB adapter may delay every sample by up to {} ms: its latency timer.",
        "the latency timer, and delays that would not show it",
        with_timer(16, lambda at: at),
        with_timer(1, lambda at: at),
    ),
    Row(
        "{} lost ({}): this host could not decode them in time and left bytes out.",
        "bytes that this host left out while they arrived",
        with_drop(left_out, 3.0),
        with_drop(left_out, 7.0),
        instead="cause is unknown",
    ),
    Row(
        "{} of {} were left out: they arrived faster than this host can decode them.",
        "bytes that this host left out",
        with_drop(left_out, 3.0),
        on(without(frames(4), 250, 290)),
    ),
    Row(
        "{} lost ({}): bytes in between failed their checks, so they were damaged on their way here.",
        "rejects between, of as many bytes as are lost",
        on(damaged(EVEN, range(150, 160))),
        on(ONE_CUT),
        instead="too few for all of them",
    ),
    Row(
        "{} lost ({}): bytes in between failed their checks, but too few for all of them: the others did not arrive.",
        "rejects between, of fewer bytes than are lost",
        on(ONE_CUT),
        on(damaged(EVEN, range(150, 160))),
    ),
    Row(
        "{} lost ({}): this host's receive buffer was full, and datagrams were dropped.",
        "the kernel's count of dropped datagrams (socket backlog)",
        with_drop(overflowed, 3.0, kind="udp"),
        with_drop(overflowed, 7.0, kind="udp"),
        instead="The network, this host or the device dropped them",
    ),
    Row(
        "{} datagrams were lost in this host's receive buffer: it was busy, or the buffer is small "
        "(`sudo sysctl net.core.rmem_max=8388608`).",
        "the kernel's count of dropped datagrams (socket backlog)",
        notices(5),
        notices(0),
    ),
    Row(
        "{} lost ({}): datagrams did not arrive. The network, this host or the device dropped them.",
        "a gap of the counter on UDP, without rejects between",
        on(without(EVEN, 150, 160), kind="udp"),
        on(damaged(EVEN, range(150, 160)), kind="udp"),
    ),
    Row(
        "{} lost ({}): possibly because the line is at {} % of its capacity. Lower a rate or raise the baud.",
        "line load",
        on(without(FULL, 1000, 1010)),
        on(without(EVEN, 150, 160)),
        instead="cause is unknown",
    ),
    Row(
        "{} lost ({}): the cause is unknown; nothing damaged was received.",
        "a gap of the counter, and nothing else",
        on(without(EVEN, 150, 160)),
        on(damaged(EVEN, range(150, 160))),
    ),
    Row(
        "{} lost ({}): the device restarted.",
        "an answer of the device: WakeUp",
        answered(WAKE_UP),
        answered(),
        instead="cause is unknown",
    ),
    Row(
        "{} more lost in {}, for several reasons.",
        "the cause of each gap",
        on([one for k, one in enumerate(damaged(frames(3), range(101, 300, 8))) if k % 8 != 1 or k < 100]),
        on([one for k, one in enumerate(frames(3)) if k % 4 != 1 or k < 100]),
        instead=r"more lost in \d+ gaps: the cause is unknown",
    ),
    Row(
        "the line is nearly full, so frames may wait in the device for an unknown time",
        "line load, for five seconds",
        on(FULL),
        on(PEAK),
    ),
    Row(
        "{} reported as lost earlier were not lost: a {} number was false, damaged or forged, and the frames after it "
        "contradict it.",
        "the numbers of the frames after it",
        numbered([*range(10, 15), 60_010, *range(15, 35)]),
        numbered([*range(10, 15), *range(1010, 1035)]),
    ),
    Row(
        "The sequence numbers went back, so intact frames are left out: the device may have restarted. ",
        "three frames in a row with old numbers",
        numbered([*range(5000, 5100), *range(100)]),
        numbered([*range(5000, 5100), 5090, 5091, *range(5100, 5200), 5150]),
    ),
    Row("{} lost ({}): the link was down.", "the link's own error", away(is_down=True), away(is_down=False)),
    Row(
        "{} has norm {} instead of 1, so it gives no attitude.",
        "the norm",
        on(frames(2, norm=1.3)),
        on(frames(2)),
    ),
]


@each_row("row", CAUSES, ids=lambda row: row.sentence[:60])
async def test_a_cause_is_measured_or_called_possible(row: Row, tmp_path: Path) -> None:
    stated = re.compile(re.escape(row.sentence).replace(r"\{\}", ".+"))
    true, alike = await row.true(tmp_path / "true"), await row.alike(tmp_path / "alike")
    assert any(map(stated.search, true)), (row.sentence, true)
    assert any(map(stated.search, alike)) == row.may, (row.sentence, alike)
    assert not row.may or POSSIBLE.search(row.sentence)
    assert any(re.search(row.instead, words) for words in alike) or not row.instead, (row.instead, alike)


POSSIBLE = re.compile(r"\b(?:may|possibly|if|If)\b")
CAUSAL = re.compile(
    r"\b(?:because|so (?:the|they|it|that|frames)|likely|possibly|probably|may have|may (?:hold|be|wait|delay)"
    r"|cause is|due to|busy|dropped|damaged|restarted|was down|paused|was full|left out|left bytes|forged|supply"
    r"|expires|reasons|did not (?:run|arrive)|in the last minute|over the network)\b"
)
FOLDERS = ("server/devices", "server/extensions/alarms", "server/extensions/evidence", "server/extensions/clocks")
FOLDERS += ("server/extensions/fleet/model", "recordings/columns", "protocols/clocks")
FILES = ("server/links/udp.py", "server/library/reject_reasons.py", "protocols/xbus/output_changes.py")
NOT_A_CAUSE = {
    "share of samples lost in the last minute, 0 … 1; null if unknown": "LossWindow(60)",
    "%s is damaged; reports after the damage are left out.": "of a journal",
    "A report for the fleet is left out. %s": "of a journal",
    "the columns in {} are damaged: {}": "of a cache",
    "the header is damaged, or is not a header": "both are possible",
    "the payload is damaged": "its check is wrong",
    "Its baud rate may have changed; it is detected again.": "what is done next",
    "Bytes arrive faster than this host can decode them: the oldest are left out. A recording has them all.": "counted",
    "Sequence restarted: {} sends old numbers ({}), which Secure mode rejects.": "the number is compared",
    "If it was restarted, re-arm it, here or with `imuscope rearm`. If not, this may be a replay of captured frames.": (
        "both are possible"
    ),
    "A restarted device is accepted again 3 s after its last accepted frame; no action is needed.": "a rule",
    "No data for {}: the link was down. The number of lost samples is not known.": "as that of known losses",
    "An internal error stopped the decoder of this device; it was restarted. The log has details.": "the decoder",
    "The device does not send, so that its clock is not observed. Reconnect it, or start it.": "of the alarm",
    "It may have cleared by itself.": "an alarm",
    "It may have been deleted; choose one of the list.": "an alarm",
    "{}, {}: {} of {} samples; of each {} the least and the greatest, so that extremes are kept.": "of the figures",
    "Position left out: {}, {} and {} in texts.": "privacy",
    "[position left out]": "privacy",
    " Where a counter restarted, the number of lost samples is not known.": "of the sentences above",
}
"""Sentences that the words of causes are in, and why no stream can make them false."""


def sentences(path: Path) -> Iterator[str]:
    """Texts of a file, "{}" for what they are given, without docstrings."""
    parts: set[int] = set()
    prose = facts_of(path).prose
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.JoinedStr):
            parts.update(map(id, node.values))
            yield "".join(str(one.value) if isinstance(one, ast.Constant) else "{}" for one in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            is_text = " " in node.value and id(node) not in parts and node.lineno not in prose
            yield from [node.value] if is_text else []


def test_every_sentence_with_a_cause_has_a_row() -> None:
    rows = [row.sentence for row in CAUSES]
    without = [
        f"{path.relative_to(ROOT)}: {text}"
        for path in [*python_files(*FOLDERS), *(ROOT / one for one in FILES)]
        for text in sentences(path)
        if CAUSAL.search(text) and text not in NOT_A_CAUSE and not any(text in row for row in rows)
    ]
    assert not without, "\n".join([*without, "Give each a row in CAUSES: what proves it, and what looks like it."])
