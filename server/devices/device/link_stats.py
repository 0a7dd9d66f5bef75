"""Link statistics of a device: rates over the last two seconds, counts since the session began.

Latency is the time from the arrival of the oldest waiting byte until its samples were passed to the browsers.
"""

from collections import Counter, deque
from collections.abc import Iterable, Sequence

from imuscope.protocols.events import Batch
from imuscope.protocols.family.info import StreamTraits
from imuscope.server.concurrency.rate_meter import RateMeter
from imuscope.server.text.prometheus import Histogram
from imuscope.server.wire import MessageHealth

MAX_MESSAGES = 256  # counted by name; a healthy device has a few dozen, noise can produce any number
OTHERS = "other messages"
RATES, RATE_WINDOW_S = 8, 1.0
SPANS = 64
RATE_TOLERANCE = 2.0  # a host that catches up sees twice the rate
FEW_LOST = 16  # a gap may end anywhere in a chunk
LATENCIES_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # a flush may wait 8 or 16 ms


class LinkStatistics:
    """Counters and rate meters of one session, for its health report."""

    def __init__(self) -> None:
        self.bytes = RateMeter()
        self.messages: dict[str, RateMeter] = {}
        self.gaps = 0
        self.lost = 0
        self.restarts = 0  # of a counter: how many samples were lost there is not known
        self.numbered = 0  # samples received that counters number: lost ones are a share of these and themselves
        self._numbered_at = -1  # first offset of the frames that were counted last
        self._window = 0.0, 0  # arrival at its beginning, unix s, and `numbered` then
        self._rates: deque[float] = deque(maxlen=RATES)  # of `numbered` in the last windows, 1/s
        self.rejects = 0
        self.rejects_by: Counter[str] = Counter()  # reason → count
        self.unclaimed = 0  # bytes that belong to no accepted frame and no known message
        self.verified: int | None = None  # samples; None if the protocol does not verify
        self.unverified: int | None = None
        self.left_out = 0  # bytes dropped because they could not be decoded in time
        self.left_out_at = float("-inf")  # time of the last drop, unix s
        self.left_out_spans: deque[tuple[float, float]] = deque(
            maxlen=SPANS
        )  # arrivals around the latest drops, unix s
        self.last_arrival: float | None = None  # of bytes
        self.last_sample: float | None = None  # of a decoded message
        self.last_batch = self.batch_interval = 0.0  # arrival of the newest samples, unix s, and since those before, s
        self.latency = Histogram(LATENCIES_S)  # s
        self._waiting_since: float | None = None

    def count_chunks(self, sizes: Sequence[int], arrivals: Sequence[float]) -> None:
        """Count received chunks, at least one, in order."""
        self.bytes.add_all(sizes, arrivals)
        self.last_arrival = arrivals[-1]
        if self._waiting_since is None:
            self._waiting_since = arrivals[0]

    def note_published(self, now: float) -> None:
        """Note that the received bytes are decoded and published."""
        if self._waiting_since is not None:
            self.latency.add(max(0.0, now - self._waiting_since))
            self._waiting_since = None

    def samples(self, message: str, count: int, now: float) -> None:
        """Count decoded samples of a message."""
        meter = self.messages.get(message)
        if meter is None:
            if len(self.messages) >= MAX_MESSAGES:
                message = OTHERS
            meter = self.messages.setdefault(message, RateMeter())
        meter.add(count, now)
        self.last_sample = max(now, self.last_sample or now)

    def count_batch(self, batch: Batch) -> None:
        """Count a batch of samples."""
        arrival = float(batch.arrival_ns[-1]) / 1e9
        self.samples(batch.message.name, len(batch), arrival)
        if arrival > self.last_batch:  # not another message of the same chunk
            self.batch_interval = arrival - self.last_batch if self.last_batch else 0.0
            self.last_batch = arrival

    def count_numbered(self, batch: Batch, stream: StreamTraits) -> None:
        """Count samples that the counter of their device numbers. Several batches of the same frames count once."""
        if len(batch) and batch.offset[0] != self._numbered_at and stream.numbers(batch.message):
            self._numbered_at = int(batch.offset[0])
            if not self.numbered:
                self._window = float(batch.arrival_ns[0]) / 1e9, 1
            self.numbered += len(batch)
            since, before = self._window
            if (arrival := float(batch.arrival_ns[-1]) / 1e9) - since >= RATE_WINDOW_S:
                self._rates.append((self.numbered - before) / (arrival - since))
                self._window = arrival, self.numbered

    def can_be_lost(self, count: int, seconds: float, rate: float) -> bool:
        """Whether a device can have sent so many samples in that time, at the fastest rate of the last windows or at
        `rate`, that of the samples next to them; 0: unknown.
        """
        fastest = max(rate, *self._rates, 0.0)
        return fastest == 0 or count <= RATE_TOLERANCE * fastest * seconds + FEW_LOST

    def rejected(self, reasons: Iterable[str]) -> None:
        """Count rejected frames by reason."""
        self.rejects_by.update(reasons)
        self.rejects = self.rejects_by.total()

    def count_verified(self, count: int, verified: bool) -> None:
        """Count samples of a protocol that verifies them."""
        self.verified = (self.verified or 0) + (count if verified else 0)
        self.unverified = (self.unverified or 0) + (0 if verified else count)

    def reset_decoding(self) -> None:
        """Reset counts that do not apply to changed decode options: rejects and verified samples."""
        self.rejects, self.rejects_by = 0, Counter()
        self.verified = self.unverified = None

    def report(self, now: float) -> list[MessageHealth]:
        """Rates and counts of all messages, the most frequent first."""
        messages = [MessageHealth(name, meter.rate(now), meter.total) for name, meter in self.messages.items()]
        return sorted(messages, key=lambda one: -one.count)
