"""Events of a stream as rate-limited sentences.

Every decoder event that is not a sample becomes a sentence in the event log: losses, bad frames, clock steps. Events
are never dropped on their way to a browser, so they must be few: each sort is limited to a few a second, and further
ones are summed up in one sentence at the end of the second. Noise on the wire thus causes at most two events a second,
with exact counts. Continuing rejects for the same reasons are reported less and less often, finally once a minute.
"""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from imuscope.protocols.events import ClockStep, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.schema.labels import device_label
from imuscope.protocols.schema.plural import counted
from imuscope.server.streaming.sink import TelemetrySink
from imuscope.server.wire import EventKind, Level
from imuscope.server.wire.codec import to_json_safe

PERIOD_S = 1.0
GAPS_PER_PERIOD = 10
RESTART_LEAD_S = 0.02
MAX_S, QUIET_S = 60.0, 10.0  # longest interval between sums of continuing rejects; pause after which they are new
ENDED_S = 0.5  # without rejects: the series has ended and is summed up
REPLIES_PER_PERIOD = 20
SHOWN_VALUES = 4
TEXT_SORTS = 64  # reported, each once: a repeating sentence is a stream whose values are channels
DATE_NS = 5 * 365 * 86_400 * 10**9  # a clock that moves by years was not wrong, but did not know the date


@dataclass(slots=True)
class _Sum:
    """Suppressed events of one sort in this period."""

    count: int = 0
    samples: int = 0
    t0: float = float("inf")
    t1: float = float("-inf")
    parts: Counter[str] = field(default_factory=Counter)
    last: str = ""

    def span(self, t0: float, t1: float) -> None:
        self.t0, self.t1 = min(self.t0, t0), max(self.t1, t1)


@dataclass(frozen=True, slots=True)
class LossCause:
    """Cause of a loss: one word for `data`, and the end of the displayed sentence."""

    by: str
    words: str


class EventReporter:
    """Log entries from the decoder events of one device, rate limited."""

    def __init__(self, sink: TelemetrySink, device: str) -> None:
        self._sink = sink
        self._device = device
        self.job = ""  # title of the job that stopped the device, until it sends again
        self._period = 0.0
        self._counts: Counter[str] = Counter()
        self._sums: dict[str, _Sum] = {}
        self._rejected: set[str] = set()  # recent reasons of rejects
        self._rejected_due = 0.0  # time of the next report, unix s
        self._rejected_wait = PERIOD_S
        self._texts: set[tuple[str, str]] = set()  # protocol and name of reported sentences

    def report(self, kind: EventKind, level: Level, text: str, **more: Any) -> None:
        """Report an event that is rare by nature."""
        self._sink.event(self._device, kind, level, text, **more)

    def gap(self, gap: SampleGap, t0: float, t1: float, blame: LossCause) -> None:
        """Report samples that are missing according to a counter, between the host times `t0` and `t1`."""
        if self._sink.reports_every_gap or self._is_allowed("gap", GAPS_PER_PERIOD):
            text = f"{_samples(gap.missing)} lost ({_duration(t1 - t0)}): {blame.words}"
            data = {"counter": gap.counter, "by": blame.by}
            level: Level = "info" if blame.by == "request" else "error"
            self.report("gap", level, text, time=t1, span=(t0, t1), samples=gap.missing, data=data)
            return
        suppressed = self._suppress("gap")
        suppressed.samples += gap.missing
        suppressed.last = blame.words
        suppressed.parts[blame.by] += 1
        suppressed.span(t0, t1)

    def pause(self, t0: float, t1: float, words: str) -> None:
        """Report that the device measured nothing between two host times at a request: `words` give the reason."""
        because = f"imuscope had stopped the device (“{self.job}”)." if self.job else words
        text = f"No samples for {_duration(t1 - t0)}: {because}"
        self.report("gap", "info", text, time=t1, span=(t0, t1), data={"by": "request"})

    def counter_restarted(self, gap: SampleGap, t0: float, t1: float, *, with_clock: bool) -> None:
        """Report a counter that does not continue: its difference does not count samples."""
        how = "together with the clock, so the device restarted"
        if not with_clock:
            how = f"by {gap.missing + 1} in {_duration(t1 - t0)}, which is more than the device sends"
        text = f"The {gap.counter} moved {how}: the number of lost samples is not known."
        self.report("gap", "error", text, time=t1, span=(t0, t1), data={"counter": gap.counter, "by": "restart"})

    def old_frames(self, time: float) -> None:
        """Report intact frames that are refused, as their numbers went back."""
        text = "The sequence numbers went back, so intact frames are left out: the device may have restarted. "
        text += "The number of lost samples is not known."
        self.report("gap", "error", text, time=time, data={"counter": "sequence", "by": "restart"})

    def gap_withdrawn(self, gap: SampleGap) -> None:
        """Report that samples reported as lost were not."""
        text = (
            f"{_samples(-gap.missing)} reported as lost earlier were not lost: a {gap.counter} number was false, "
            "damaged or forged, and the frames after it contradict it."
        )
        data = {"counter": gap.counter, "withdrawn": -gap.missing}
        if self._is_allowed("withdrawn", GAPS_PER_PERIOD):
            self.report("device", "warning", text, time=gap.arrival_ns / 1e9, data=data)

    def outage(self, span: tuple[float, float], known: tuple[str, int] | None) -> None:
        """Report that the link was down; `known`: a counter and the number of samples missed."""
        counter, missing = known or ("", 0)
        duration = _duration(span[1] - span[0])
        text = f"No data for {duration}: the link was down. The number of lost samples is not known."
        if known is not None:
            text = f"{_samples(missing)} lost ({duration}): the link was down."
        self.report("gap", "error", text, span=span, samples=missing, data={"counter": counter, "by": "link"})

    def rejects(self, rejects: list[RejectedFrame]) -> None:
        """Add rejected frames; they are always summed up, one event a period."""
        if not rejects:
            return
        suppressed = self._sums.setdefault("reject", _Sum())
        suppressed.count += len(rejects)
        suppressed.samples += sum(reject.size for reject in rejects)
        for reason, count in Counter(reject.reason for reject in rejects).items():
            suppressed.parts[reason.replace("_", " ")] += count
        arrivals = [reject.arrival_ns for reject in rejects]
        suppressed.span(min(arrivals) / 1e9, max(arrivals) / 1e9)

    def step(self, step: ClockStep, time: float) -> None:
        words = {
            "reset": "The device's clock started again from zero.",
            "jump": f"The device's clock {_moved(step.by_ns / 1e9)}.",
            "log": f"The clock of the log {_moved(step.by_ns / 1e9)}.",
            "sync": f"The device's clock was synchronised and moved by {_signed(step.by_ns / 1e9)}.",
        }
        if self._is_allowed("clock", GAPS_PER_PERIOD):
            text = words.get(step.kind, f"The device's clock: {step.kind}, {_signed(step.by_ns / 1e9)}.")
            if step.kind == "sync" and step.by_ns > DATE_NS:
                text = "The device has received the date: its clock counted from power-on, and is UTC from here on."
            data = {"kind": step.kind, "by_ns": step.by_ns}
            self.report("clock", "warning", text, time=time, data={k: to_json_safe(v) for k, v in data.items()})
        else:
            self._suppress("clock").parts[step.kind] += 1

    def report_restart(self, text: str, arrival: float) -> None:
        """Report that a file starts again: clocks and counters restart, and nothing was lost."""
        if self._is_allowed("again", 1):
            # Slightly earlier, like the host time of the first sample may be: a page breaks its lines there.
            self.report("clock", "info", text, time=arrival - RESTART_LEAD_S, data={"kind": "again"})

    def reply(self, reply: Reply) -> None:
        """Report an answer or indication, with its values."""
        message = reply.message
        refuses = next(iter(reply.values.values()), None) in message.refusals  # the job that was refused says so
        level: Level = "warning" if message.name in ("Error", "Warning", "WakeUp") and not refuses else "info"
        if self._is_allowed("reply." + message.name, REPLIES_PER_PERIOD):
            text = _sentence(reply) or f"{message.title or message.name}{_values(reply)}"
            data = {"message": message.name, "values": to_json_safe(reply.values)}
            self.report("reply", level, text, time=reply.arrival_ns / 1e9, data=data)
        else:
            self._suppress("reply." + message.name)

    def text(self, text: Text) -> None:
        """Report a line of text in the stream: the first of each sort, up to a number of sorts."""
        sort = text.protocol, text.name
        if sort in self._texts or len(self._texts) > TEXT_SORTS:
            return
        self._texts.add(sort)
        if len(self._texts) > TEXT_SORTS:
            words = f"More than {TEXT_SORTS} kinds of sentences received: further kinds are not listed."
            self.report("text", "warning", words, data={"most": TEXT_SORTS})
            return
        data = {"protocol": text.protocol, "name": text.name, "fields": to_json_safe(text.fields)}
        self.report("text", "info", text.line.strip()[:400], time=text.arrival_ns / 1e9, data=data)

    def tick(self, now: float) -> None:
        """Sum up the suppressed events at the end of a period."""
        suppressed = self._sums.get("reject")
        if suppressed is not None and self._has_ended(suppressed, now):
            self._report_rejects(self._sums.pop("reject"), now)
        if now - self._period < PERIOD_S:
            return
        self._period = now
        self._counts.clear()
        sums, self._sums = self._sums, {}
        for sort, suppressed in sums.items():
            if sort != "reject":
                self._sum_up(sort, suppressed)
            elif suppressed.parts.keys() <= self._rejected and now < self._rejected_due:
                self._sums[sort] = suppressed  # no new reason: less and less often
            else:
                self._report_rejects(suppressed, now)

    def _has_ended(self, suppressed: _Sum, now: float) -> bool:
        """Whether a series of rejects is over; the longer it lasted, the longer the required pause."""
        values = self._rejected_due - self._rejected_wait / 2
        return now - suppressed.t1 > max(ENDED_S, self._rejected_wait / 8) and now - values >= PERIOD_S

    def _report_rejects(self, suppressed: _Sum, now: float) -> None:
        if now > self._rejected_due + QUIET_S:
            self._rejected, self._rejected_wait = set(), PERIOD_S
        self._rejected |= suppressed.parts.keys()
        self._rejected_due = now + self._rejected_wait
        self._rejected_wait = min(2 * self._rejected_wait, MAX_S)
        self._sum_up("reject", suppressed)

    def _sum_up(self, sort: str, suppressed: _Sum) -> None:
        span = (suppressed.t0, suppressed.t1) if suppressed.t1 >= suppressed.t0 else None
        if sort == "gap":
            why = f": {suppressed.last}" if len(suppressed.parts) == 1 else ", for several reasons."
            text = f"{_samples(suppressed.samples)} more lost in {counted(suppressed.count, 'gap')}{why}"
            data = {"gaps": suppressed.count, "by": suppressed.parts.most_common(1)[0][0]}
            self.report("gap", "error", text, span=span, samples=suppressed.samples, data=data)
        elif sort == "reject":
            reasons = ", ".join(f"{count} {reason}" for reason, count in suppressed.parts.most_common(4))
            text = f"{counted(suppressed.count, 'frame')} rejected: {reasons}."
            self.report(
                "reject", "warning", text, span=span, samples=suppressed.count, data={"reasons": dict(suppressed.parts)}
            )
        elif sort == "clock":
            self.report("clock", "warning", f"The device's clock stepped {counted(suppressed.count, 'more time')}.")
        else:
            name = sort.partition(".")[2]
            self.report(
                "reply", "info", f"{name} received {counted(suppressed.count, 'more time')}.", data={"message": name}
            )

    def _is_allowed(self, sort: str, per_period: int) -> bool:
        if self._counts[sort] >= per_period:
            return False
        self._counts[sort] += 1
        return True

    def _suppress(self, sort: str) -> _Sum:
        suppressed = self._sums.setdefault(sort, _Sum())
        suppressed.count += 1
        return suppressed


def _samples(count: int) -> str:
    return counted(count, "sample")


def _duration(seconds: float) -> str:
    return f"{seconds * 1e3:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"


def _moved(seconds: float) -> str:
    way = "was set back" if seconds < 0 else "jumped ahead"
    return f"{way} by {_signed(abs(seconds)).lstrip('+')}"


def _signed(seconds: float) -> str:
    sign = "−" if seconds < 0 else "+"
    size = abs(seconds)
    return f"{sign}{size * 1e3:.3g} ms" if size < 1 else f"{sign}{size:.6g} s"


def _sentence(reply: Reply) -> str:
    """Sentence for a decoder's warning about a device; "" for any other reply."""
    words = str(reply.values.get("warning", "")) if reply.message.name == "Warning" else ""
    return f"{words[0].upper()}{words[1:]}." if words else ""


def _values(reply: Reply) -> str:
    """The values of a reply, short enough for a line; of many, the first non-zero ones. All are in `data`."""
    shown = {name: value for name, value in reply.values.items() if not name.startswith("reserved")}
    for field_ in reply.message.fields:
        if field_.base == 16 and isinstance(shown.get(field_.name), int):
            shown[field_.name] = device_label(shown[field_.name])
    choices = {field_.name: field_.choices for field_ in reply.message.fields}
    values = {name: value for name, value in to_json_safe(shown).items() if not isinstance(value, list | dict)}
    if len(values) > SHOWN_VALUES:
        values = {name: value for name, value in values.items() if str(value).strip("0")}
    parts = [f"{name} {choices.get(name, {}).get(value, value)}" for name, value in values.items()]
    text = ", ".join(parts[:SHOWN_VALUES]) + (" …" if len(parts) > SHOWN_VALUES else "")
    return f": {text[:160]}" if text else ""
