"""Lost samples of a device: what counts as lost, from which cause, and their share, for all that state one.

Lost samples are those that a counter shows, as far as the device's clock agrees: a counter that moves together with a
restarted clock, or further than the device sends in that time, restarted itself, and the number of lost samples is not
known. The share is that of all samples which the counter numbers: where several messages share it, of all together.

    cause      known by
    request    a configuration or a pause on request lies in between
    host       this host left bytes out at that time, or its kernel dropped datagrams
    wire       the bytes of most of them arrived in between, and failed their checks
    network    possible: datagrams may be dropped anywhere on their way
    link       possible: the line is nearly full
"""

from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap
from imuscope.protocols.family.info import OutputChanges
from imuscope.server import wire
from imuscope.server.devices.device.event_reporter import EventReporter, LossCause
from imuscope.server.devices.device.link_stats import LinkStatistics

FULL_LINK_SHARE = 0.9  # share of a link's capacity above which it may be the cause of a gap
LEFT_OUT_S = 1.0  # between a gap and the arrival of bytes that were left out
DAMAGED_SHARE = 0.5  # of the bytes of lost frames that arrived: more cannot be expected, as frames have several sizes
NEIGHBOURS, MIN_NEIGHBOURS = 64, 8  # samples beside a gap from which a rate is taken
OLD_FRAMES = 3  # in a row: single ones were overtaken or sent twice
MAX_INTERRUPTIONS = 64  # remembered while no frame arrives


class LossReporter:
    """Gaps of one device during one connection.

    Args:
        dropped: datagrams that this host's kernel dropped so far.
        kind, capacity: of its link: wire.DeviceInfo.link, and the bytes/s that it can carry, None if unknown.

    Attributes:
        changes: notices replies that stop or change the output; None for a protocol without such replies.
        last_time, last_offset: host time (unix s) and position of the last frame of the previous drain.
        damaged_at: position of the last frame that failed its checks.
        interruptions: on request since the last frame: position, and rank and reason.
    """

    def __init__(
        self,
        stats: LinkStatistics,
        events: EventReporter,
        now: Callable[[], float],
        dropped: Callable[[], int] = lambda: 0,
        *,
        kind: str,
        capacity: float | None,
    ) -> None:
        self._stats, self._events, self._now = stats, events, now
        self._kind, self._capacity = kind, capacity
        self._dropped, self._drops, self._drops_before = dropped, 0, 0
        self.changes: OutputChanges | None = None
        self.last_time: float | None = None
        self.interruptions: list[tuple[int, tuple[int, str]]] = []
        self._explained: set[int] = set()  # positions of those that a counter has shown
        self.last_offset = self.damaged_at = self._damaged_until = -1
        self._sender = ""
        self._old_frames = 0  # since the last accepted one
        self._doubted = 0  # missing samples by a counter that its clock contradicts, not counted
        self._resets: set[int] = set()  # positions at which the clock restarted, of this drain
        self._offsets: NDArray[np.int64] = np.zeros(0, np.int64)
        self._hosts: NDArray[np.float64] = np.zeros(0)

    def begin(self, events: Sequence[Event], offsets: NDArray[np.int64], hosts: NDArray[np.float64]) -> None:
        """Begin a drain with these samples: (n,) positions, and host times (unix s), which do not decrease."""
        if self.changes is not None:
            replies = (event for event in events if isinstance(event, Reply))
            reasons = ((one.offset, self.changes.observe(one)) for one in replies)
            self.interruptions += [(offset, reason) for offset, reason in reasons if reason is not None]
            del self.interruptions[:-MAX_INTERRUPTIONS]
        self._resets = {event.offset for event in events if isinstance(event, ClockStep) and event.kind == "reset"}
        self._offsets, self._hosts = offsets, hosts
        self._stats.restarts += len(self._resets) if self._stats.numbered else 0
        self._sender = next((event.device for event in events if isinstance(event, Batch)), self._sender)
        old = (event for event in events if isinstance(event, RejectedFrame) and event.reason == "stale")
        self._note_old_frames([event for event in old if event.device in ("", self._sender)])
        self._drops_before, self._drops = self._drops, self._dropped()

    def is_new(self, reject: RejectedFrame) -> bool:
        """Whether this is another damaged frame than the one before. After a failed frame the search resumes within it,
        where bytes may look like a beginning too.
        """
        at = int(np.searchsorted(self._offsets, reject.offset))
        accepted = int(self._offsets[at - 1]) if at else self.last_offset
        is_within = accepted <= self.damaged_at and reject.offset < self._damaged_until
        self._damaged_until = reject.offset + reject.size if not is_within else self._damaged_until
        return not is_within

    def usual(self, last_time: float, last_offset: int, sender: str) -> None:
        """Process a drain of samples only, which ends there."""
        self.last_time = last_time if self.last_time is None else max(self.last_time, last_time)
        self.last_offset, self._sender, self._drops, self._old_frames = last_offset, sender, self._dropped(), 0

    def gap(self, gap: SampleGap) -> None:
        """Count and report a gap of this drain."""
        if gap.missing < 0:
            doubted = min(self._doubted, -gap.missing)
            self._doubted -= doubted
            self._stats.lost += gap.missing + doubted
            self._stats.gaps -= 1
            self._events.gap_withdrawn(gap)
            return
        self._stats.gaps += 1
        offsets, hosts = self._offsets, self._hosts
        at = int(np.searchsorted(offsets, gap.offset))
        before = float(hosts[at - 1]) if 0 < at <= len(hosts) else self.last_time
        # The first frame after the gap may have an older time (a GNSS solution): the gap ends at the first newer one.
        newer = hosts[at:] if before is None else hosts[at:][hosts[at:] > before]
        after = float(newer[0]) if len(newer) else gap.arrival_ns / 1e9
        before = after if before is None else min(before, after)
        rate = max(_rate(hosts[max(at - NEIGHBOURS, 0) : at]), _rate(hosts[at : at + NEIGHBOURS]))
        if gap.offset in self._resets or not self._stats.can_be_lost(gap.missing, after - before, rate):
            self._doubted += gap.missing
            self._stats.restarts += gap.offset not in self._resets
            self._events.counter_restarted(gap, before, after, with_clock=gap.offset in self._resets)
            return
        self._stats.lost += gap.missing
        begin = int(offsets[at - 1]) if 0 < at <= len(offsets) else self.last_offset
        spacing = max(1.0, self._stats.bytes.total / max(1, self._stats.numbered + self._stats.lost))
        damaged = (gap.offset - begin) / spacing - 1 if self.damaged_at > begin else 0.0
        cause = self._requested(begin, gap.offset) or self._cause((before, after), damaged / gap.missing)
        self._events.gap(gap, before, after, cause)

    def _note_old_frames(self, old: Sequence[RejectedFrame]) -> None:
        """Count intact frames with old numbers since the last accepted one; several in a row may be a restart."""
        last = int(self._offsets[-1]) if len(self._offsets) else -1
        before, run = 0 if last >= 0 else self._old_frames, [one for one in old if one.offset > last]
        self._old_frames = before + len(run)
        if before < OLD_FRAMES <= self._old_frames:
            self._stats.restarts += 1
            self._events.old_frames(run[OLD_FRAMES - 1 - before].arrival_ns / 1e9)

    def end(self) -> None:
        """End a drain with samples; report pauses on request that no counter has shown."""
        offsets, hosts = self._offsets, self._hosts
        known = [one for one in self.interruptions if one[0] < offsets[-1] and one[0] not in self._explained]
        for at in dict.fromkeys(int(np.searchsorted(offsets, offset)) for offset, _ in known):
            before = float(hosts[at - 1]) if at else self.last_time
            if before is not None and hosts[at] > before:
                words = max(reason for offset, reason in known if np.searchsorted(offsets, offset) == at)[1]
                self._stats.gaps += 1
                self._events.pause(before, float(hosts[at]), words)
        self._explained.clear()
        self.last_offset = int(offsets[-1])
        self.interruptions = [one for one in self.interruptions if one[0] > self.last_offset]
        self.last_time = float(hosts[-1])

    def _requested(self, begin: int, end: int) -> LossCause | None:
        """Cause of a loss between two positions, if a user requested it."""
        if self.changes is None:
            return None
        between = [(offset, reason) for offset, reason in self.interruptions if begin < offset < end]
        self._explained.update(offset for offset, _ in between)
        reasons = [reason for _, reason in between]
        reasons += [self.changes.standing] if self.changes.standing is not None else []
        return LossCause("request", max(reasons)[1]) if reasons else None

    def _cause(self, span: tuple[float, float], damaged: float) -> LossCause:
        """Cause of a loss, as far as it is measured on this host; a cause that is only possible is called so.

        Args:
            span: host times of the samples before and after it.
            damaged: share of their bytes that arrived in between and failed their checks.
        """
        t0, t1 = span[0] - LEFT_OUT_S, span[1] + LEFT_OUT_S
        if any(since <= t1 and until >= t0 for since, until in self._stats.left_out_spans):
            return LossCause("host", "this host could not decode them in time and left bytes out.")
        if damaged >= DAMAGED_SHARE:
            return LossCause("wire", "bytes in between failed their checks, so they were damaged on their way here.")
        if damaged:
            words = "bytes in between failed their checks, but too few for all of them: the others did not arrive."
            return LossCause("unknown", words)
        if self._drops > self._drops_before:
            return LossCause("host", "this host's receive buffer was full, and datagrams were dropped.")
        if self._kind == "udp":
            return LossCause("network", "datagrams did not arrive. The network, this host or the device dropped them.")
        load = link_load(self._stats, self._capacity, self._now())
        if load >= FULL_LINK_SHARE:
            words = (
                f"possibly because the line is at {100 * load:.0f} % of its capacity. Lower a rate or raise the baud."
            )
            return LossCause("link", words)
        return LossCause("unknown", "the cause is unknown; nothing damaged was received.")


def link_load(stats: LinkStatistics, capacity: float | None, now: float) -> float:
    """Share of a link's capacity that is in use; 0 if its capacity is unknown."""
    return stats.bytes.rate(now) / capacity if capacity else 0.0


def _rate(times: NDArray[np.float64]) -> float:
    """Rate of these samples, 1/s; 0 if they are too few."""
    span = float(times[-1] - times[0]) if len(times) >= MIN_NEIGHBOURS else 0.0
    return (len(times) - 1) / span if span > 0 else 0.0


class LossWindow:
    """Loss over the last seconds, from the counts of a device.

    Args:
        seconds: its length.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._counts: deque[tuple[float, int, int]] = deque()  # time, lost, received

    def add(self, health: wire.DeviceHealth) -> bool:
        """Add figures; whether they continue those before. Fewer samples are those of another session."""
        continues = not self._counts or health.numbered >= self._counts[-1][2]
        if not continues:
            self._counts.clear()
        if not self._counts or health.time > self._counts[-1][0]:
            self._counts.append((health.time, health.lost, health.numbered))
        while len(self._counts) > 2 and self._counts[1][0] <= health.time - self._seconds:
            self._counts.popleft()
        return continues

    def clear(self) -> None:
        """Forget the counts."""
        self._counts.clear()

    @property
    def share(self) -> float | None:
        """Lost samples of those sent in this time, 0..1; None if none were."""
        if not self._counts:
            return None
        (_, lost_before, before), (_, lost, received) = self._counts[0], self._counts[-1]
        missing = max(0, lost - lost_before)  # a false loss is taken back
        sent = missing + received - before
        return missing / sent if sent > 0 else None
