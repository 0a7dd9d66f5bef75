"""What is a person told when something happens to a stream, and how often?

Every decoder event that is not a sample becomes a sentence in the event log: who lost how much, which frames were bad,
that the clock was set. Events are never dropped on their way to a browser, so they must be few: each sort may speak a
few times a second, and what happens beyond that is summed up in one sentence when the second is over. Noise on the wire
thus costs two events a second at most, with exact counts in them. What is refused for the same reasons on and on is
told less and less often, at last once a minute.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from protocols.events import ClockStep, RejectedFrame, Reply, SampleGap, Text
from protocols.labels import device_label
from server.streaming.hub import Hub
from server.wire import EventKind, Level
from server.wire_codec import to_json_safe

PERIOD_S = 1.0
GAPS_PER_PERIOD = 10
AGAIN_S = 0.02
MOST_S, QUIET_S = 60.0, 10.0  # between two sums of what is refused on and on; without any, the next is news again
ENDED_S = 0.5  # without any, and it has ended: the sum is told
REPLIES_PER_PERIOD = 20
SHOWN_VALUES = 4
TEXT_SORTS = 64  # told, each once: a sentence that repeats is a stream; its values are channels, its lines are no news
DATE_NS = 5 * 365 * 86_400 * 10**9  # a clock that moves by years was not running wrong: it did not know the date


@dataclass(slots=True)
class _Sum:
    """What is held back of one sort in this period."""

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
    """Who lost samples: one word for `data`, the end of the sentence for a person."""

    by: str
    words: str


class EventReporter:
    """The sentences about one device."""

    def __init__(self, hub: Hub, device: str) -> None:
        self._hub = hub
        self._device = device
        self._period = 0.0
        self._told: Counter[str] = Counter()
        self._sums: dict[str, _Sum] = {}
        self._refused: set[str] = set()  # why frames were refused lately
        self._refused_due = 0.0  # when it is told again, unix s
        self._refused_wait = PERIOD_S
        self._texts: set[tuple[str, str]] = set()  # protocol and name of the sentences that were told

    def say(self, kind: EventKind, level: Level, text: str, **more: Any) -> None:
        """An event that is rare by nature."""
        self._hub.event(self._device, kind, level, text, **more)

    def gap(self, gap: SampleGap, t0: float, t1: float, blame: LossCause) -> None:
        """Samples that a counter says are missing between the host times `t0` and `t1`."""
        if self._hub.tells_every_gap or self._may("gap", GAPS_PER_PERIOD):
            text = f"{_samples(gap.missing)} lost ({_duration(t1 - t0)}): {blame.words}"
            data = {"counter": gap.counter, "by": blame.by}
            self.say("gap", "fault", text, time=t1, span=(t0, t1), samples=gap.missing, data=data)
            return
        held = self._hold("gap")
        held.samples += gap.missing
        held.last = blame.words
        held.parts[blame.by] += 1
        held.span(t0, t1)

    def outage(self, span: tuple[float, float], known: tuple[str, int] | None) -> None:
        """The link was down; `known`: which counter says how many samples passed meanwhile."""
        counter, missing = known or ("", 0)
        duration = _duration(span[1] - span[0])
        text = f"Nothing came for {duration}: the link was down. How many samples is not known."
        if known is not None:
            text = f"{_samples(missing)} lost ({duration}): the link was down."
        self.say("gap", "fault", text, span=span, samples=missing, data={"counter": counter, "by": "link"})

    def rejects(self, rejects: list[RejectedFrame]) -> None:
        """Candidates that failed their checks: always summed up, one event a period."""
        if not rejects:
            return
        held = self._sums.setdefault("reject", _Sum())
        held.count += len(rejects)
        held.samples += sum(reject.size for reject in rejects)
        for reason, count in Counter(reject.reason for reject in rejects).items():
            held.parts[reason.replace("_", " ")] += count
        arrivals = [reject.arrival_ns for reject in rejects]
        held.span(min(arrivals) / 1e9, max(arrivals) / 1e9)

    def step(self, step: ClockStep, time: float) -> None:
        """The device clock did not continue."""
        words = {
            "reset": "The device's clock started again from zero.",
            "jump": f"The device's clock jumped by {_signed(step.by_ns / 1e9)}.",
            "sync": f"The device's clock was synchronised and moved by {_signed(step.by_ns / 1e9)}.",
        }
        if self._may("clock", GAPS_PER_PERIOD):
            text = words.get(step.kind, f"The device's clock: {step.kind}, {_signed(step.by_ns / 1e9)}.")
            if step.kind == "sync" and step.by_ns > DATE_NS:
                text = "The device has learned the date: its clock counted from power-on, and is UTC from here on."
            data = {"kind": step.kind, "by_ns": step.by_ns}
            self.say("clock", "caution", text, time=time, data={k: to_json_safe(v) for k, v in data.items()})
        else:
            self._hold("clock").parts[step.kind] += 1

    def again(self, text: str, arrival: float) -> None:
        """What is played begins again with what arrived then: clocks and counters start anew, and nothing was lost."""
        if self._may("again", 1):
            # A little before, as the first sample's time on this host may be: a page breaks its lines there.
            self.say("clock", "info", text, time=arrival - AGAIN_S, data={"kind": "again"})

    def reply(self, reply: Reply) -> None:
        """An answer or indication, with its values."""
        message = reply.message
        level: Level = "caution" if message.name in ("Error", "Warning", "WakeUp") else "info"
        if self._may("reply." + message.name, REPLIES_PER_PERIOD):
            text = _sentence(reply) or f"{message.title or message.name}{_values(reply)}"
            data = {"message": message.name, "values": to_json_safe(reply.values)}
            self.say("reply", level, text, time=reply.arrival_ns / 1e9, data=data)
        else:
            self._hold("reply." + message.name)

    def text(self, text: Text) -> None:
        """A line of text in the stream: the first of each sort, as long as there are not too many sorts."""
        sort = text.protocol, text.name
        if sort in self._texts or len(self._texts) > TEXT_SORTS:
            return
        self._texts.add(sort)
        if len(self._texts) > TEXT_SORTS:
            words = f"More than {TEXT_SORTS} kinds of sentences came: the first lines of further ones are not told."
            self.say("text", "caution", words, data={"most": TEXT_SORTS})
            return
        data = {"protocol": text.protocol, "name": text.name, "fields": to_json_safe(text.fields)}
        self.say("text", "info", text.line.strip()[:400], time=text.arrival_ns / 1e9, data=data)

    def tick(self, now: float) -> None:
        """Sum up what was held back, when the period is over."""
        held = self._sums.get("reject")
        if held is not None and self._has_ended(held, now):
            self._tell_refused(self._sums.pop("reject"), now)
        if now - self._period < PERIOD_S:
            return
        self._period = now
        self._told.clear()
        sums, self._sums = self._sums, {}
        for sort, held in sums.items():
            if sort != "reject":
                self._sum_up(sort, held)
            elif held.parts.keys() <= self._refused and now < self._refused_due:
                self._sums[sort] = held  # nothing new: less and less often
            else:
                self._tell_refused(held, now)

    def _has_ended(self, held: _Sum, now: float) -> bool:
        """Has nothing been refused for a while? The longer it went on, the longer."""
        told = self._refused_due - self._refused_wait / 2
        return now - held.t1 > max(ENDED_S, self._refused_wait / 8) and now - told >= PERIOD_S

    def _tell_refused(self, held: _Sum, now: float) -> None:
        if now > self._refused_due + QUIET_S:
            self._refused, self._refused_wait = set(), PERIOD_S
        self._refused |= held.parts.keys()
        self._refused_due = now + self._refused_wait
        self._refused_wait = min(2 * self._refused_wait, MOST_S)
        self._sum_up("reject", held)

    def _sum_up(self, sort: str, held: _Sum) -> None:
        span = (held.t0, held.t1) if held.t1 >= held.t0 else None
        if sort == "gap":
            text = f"{_samples(held.samples)} more lost in {held.count} gaps: {held.last}"
            data = {"gaps": held.count, "by": held.parts.most_common(1)[0][0]}
            self.say("gap", "fault", text, span=span, samples=held.samples, data=data)
        elif sort == "reject":
            reasons = ", ".join(f"{count} {reason}" for reason, count in held.parts.most_common(4))
            text = f"{held.count} frame{'s' if held.count > 1 else ''} rejected: {reasons}."
            self.say("reject", "caution", text, span=span, samples=held.count, data={"reasons": dict(held.parts)})
        elif sort == "clock":
            self.say("clock", "caution", f"The device's clock stepped {held.count} more times.")
        else:
            name = sort.partition(".")[2]
            self.say("reply", "info", f"{name} came {held.count} more times.", data={"message": name})

    def _may(self, sort: str, per_period: int) -> bool:
        if self._told[sort] >= per_period:
            return False
        self._told[sort] += 1
        return True

    def _hold(self, sort: str) -> _Sum:
        held = self._sums.setdefault(sort, _Sum())
        held.count += 1
        return held


def _samples(count: int) -> str:
    return f"{count} sample{'' if count == 1 else 's'}"


def _duration(seconds: float) -> str:
    return f"{seconds * 1e3:.0f} ms" if seconds < 10 else f"{seconds:.1f} s"


def _signed(seconds: float) -> str:
    sign = "−" if seconds < 0 else "+"
    size = abs(seconds)
    return f"{sign}{size * 1e3:.3g} ms" if size < 1 else f"{sign}{size:.6g} s"


def _sentence(reply: Reply) -> str:
    """What a decoder says of a device in words of its own; "" of any other reply."""
    words = str(reply.values.get("warning", "")) if reply.message.name == "Warning" else ""
    return f"{words[0].upper()}{words[1:]}." if words else ""


def _values(reply: Reply) -> str:
    """The values of a reply, short enough for a line: of many, the first that are not zero. All are in `data`."""
    shown = {name: value for name, value in reply.values.items() if not name.startswith("reserved")}
    for field_ in reply.message.fields:
        if field_.base == 16 and isinstance(shown.get(field_.name), int):
            shown[field_.name] = device_label(shown[field_.name])
    choices = {field_.name: field_.choices for field_ in reply.message.fields}
    told = {name: value for name, value in to_json_safe(shown).items() if not isinstance(value, list | dict)}
    if len(told) > SHOWN_VALUES:
        told = {name: value for name, value in told.items() if str(value).strip("0")}
    parts = [f"{name} {choices.get(name, {}).get(value, value)}" for name, value in told.items()]
    text = ", ".join(parts[:SHOWN_VALUES]) + (" …" if len(parts) > SHOWN_VALUES else "")
    return f": {text[:160]}" if text else ""
