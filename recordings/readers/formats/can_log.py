"""Logs of CAN frames: `candump -l`, candump on a terminal, Vector's ASC. The frames of devices that are known become
the stream of protocols/can/, with lines of its own for each device.

A first pass finds the identifiers, the kind of the times, and the devices (protocols/can/survey.py). The time of a
line is the arrival of its frame:

    since 1970               as it is; candump -t A writes local time, which is taken for UTC
    since the start          dated by the UTC that a device sends, else by head, name or last change of the file
    since the line before    added up, and dated in the same way
    none                     the clock of a device gives the spacing, if one sends it

Where it goes back by more than a millisecond the arrival continues, and the step is reported. It begins a segment of a
device without a clock of its own; a device that has one is not affected.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.can.decoder import EARLIEST_YEAR, utc_of_records
from imuscope.protocols.can.definition import identifier_text, step_line
from imuscope.protocols.can.lines import (
    BUS,
    BUS_KEY,
    DATA,
    ERROR,
    FD,
    LINE,
    REQUEST,
    STAMP,
    payloads,
)
from imuscope.protocols.can.survey import CanDevice, CanIdentifier, devices_of, message_names
from imuscope.protocols.clocks.counters import TickUnwrapper
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, SENDER
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.can_kernels import ASC, LOG, TERMINAL, read_lines, write_lines
from imuscope.recordings.readers.message_source import MessageFile
from imuscope.recordings.readers.registry import HEAD_BYTES, FileReader, OpenRequest, register_reader
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice, remark
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks.axis import origin_of
from imuscope.recordings.tables.clocks.steps import duration_text
from imuscope.recordings.tables.format import TableFormat

Since = Literal["1970", "start", "line", "none"]
"""What the times of a log are counted from."""

SAMPLE = 256  # frames of an identifier that are examined
MOST_IDENTIFIERS = 4096
MOST_STEPS = 1000
SECOND_NS = 1_000_000_000
BACK_NS = 1_000_000  # frames of two buses may be out of order by less
DATED_NS = 315_532_800 * SECOND_NS  # 1980: a later time is not since the start
STRAY_NS = 1_000_000_000
UNORDERED = 0.1  # of the times go back: they are those since the line before
NEXT_LINES = 8  # within which a time that is only out of order returns
FRAME_BYTES = 8


def strays(stamps: Ints) -> NDArray[np.bool_]:
    """(n,) whether a time since 1970 is far ahead of the one before and the one after, which are in order: damage."""
    is_stray = np.zeros(len(stamps), np.bool_)
    if len(stamps) > 2 and stamps[0] >= DATED_NS:
        before, now, after = stamps[:-2], stamps[1:-1], stamps[2:]
        is_stray[1:-1] = (now - before > STRAY_NS) & (now - after > STRAY_NS) & (after >= before)
    return is_stray


@dataclass(slots=True)
class LogSurvey:
    """Findings of the first pass.

    Args:
        identifiers: by the key of the bus and the number.
        buses: names by their keys.
        kinds: number of lines by kind.
        odd: lines without a frame.
        first: time of the first frame, ns.
        back: rows, from 0, at which the time goes back, and by how much, ns.
    """

    identifiers: dict[tuple[int, int], CanIdentifier] = field(default_factory=dict)
    buses: dict[int, str] = field(default_factory=dict)
    kinds: Counter[int] = field(default_factory=Counter)
    rows: int = 0
    odd: int = 0
    first: int = 0
    back: list[tuple[int, int]] = field(default_factory=list)
    _without: int = 0
    _unordered: int = 0
    _previous: int = 0
    _sum: int = 0
    _sums: dict[tuple[int, int], Ints] = field(default_factory=dict)

    def add(self, data: Bytes, table: Ints) -> None:
        """Add a block: its bytes, and the table of its frames (can_kernels.py)."""
        if not table.shape[1]:
            return
        kinds, counts = np.unique(table[SENDER], return_counts=True)
        for kind, count in zip(kinds.tolist(), counts.tolist(), strict=True):
            self.kinds[kind] += count
        sums = self._sum + np.cumsum(table[STAMP])
        self._sum = int(sums[-1])
        self._add_times(table[STAMP])
        is_data = table[SENDER] == DATA
        frames, sums = np.ascontiguousarray(table[:, is_data]), sums[is_data]
        _, numbers, counts = np.unique(frames[BUS_KEY] ^ frames[ID] << 15, return_inverse=True, return_counts=True)
        order, last = np.argsort(numbers, kind="stable"), 0
        for count in counts.tolist():
            self._add_frames(data, frames, order[last : last + count], sums)
            last += count

    def since(self, *, is_relative: bool) -> Since:
        """Origin of its times; `is_relative`: its head says that they are those since the line before."""
        if self._without == self.rows:
            return "none"
        if is_relative or self._unordered > UNORDERED * self.rows:
            for key, sums in self._sums.items():
                self.identifiers[key].stamps = sums
            return "line"
        return "1970" if self.first >= DATED_NS else "start"

    def of_bus(self, bus: str) -> Mapping[int, CanIdentifier]:
        """Identifiers of a bus, by number."""
        return {one.number: one for one in self.identifiers.values() if one.bus == bus}

    def _add_times(self, stamps: Ints) -> None:
        if not self.rows:
            self.first = self._previous = int(stamps[0])
        self._without += int(np.count_nonzero(stamps < 0))
        before = np.concatenate(([self._previous], stamps[:-1]))
        self._unordered += int(np.count_nonzero(stamps < before))
        for row in np.flatnonzero(before - stamps > BACK_NS)[:MOST_STEPS].tolist():
            is_back = not (stamps[row : row + NEXT_LINES] > before[row]).any()
            if is_back and len(self.back) < MOST_STEPS:
                self.back.append((self.rows + row, int(before[row] - stamps[row])))
        self._previous = int(stamps[-1])
        self.rows += len(stamps)

    def _add_frames(self, data: Bytes, frames: Ints, which: Ints, sums: Ints) -> None:
        bus, number = int(frames[BUS_KEY, which[0]]), int(frames[ID, which[0]])
        if bus not in self.buses:
            begin = int(frames[BUS, which[0]])
            self.buses[bus] = bytes(data[begin : begin + 32]).split()[0].decode(errors="replace")
        key = bus, number
        if key not in self.identifiers and len(self.identifiers) >= MOST_IDENTIFIERS:
            return
        one = self.identifiers.setdefault(key, CanIdentifier(self.buses[bus], number))
        lengths, counts = np.unique(frames[LENGTH, which], return_counts=True)
        for length, count in zip(lengths.tolist(), counts.tolist(), strict=True):
            one.of_length[length] = one.of_length.get(length, 0) + count
        chosen = which[: SAMPLE - len(one.stamps)]
        if len(chosen):
            rows = np.empty((len(chosen), FRAME_BYTES), np.uint8)
            payloads(data, frames[BODY, chosen], frames[LENGTH, chosen], rows)
            one.data = np.concatenate((one.data, rows))
            one.stamps = np.concatenate((one.stamps, frames[STAMP, chosen]))
            self._sums[key] = np.concatenate((self._sums.get(key, one.stamps[:0]), sums[chosen]))


BLOCK_BYTES = 4 << 20
LEAST_LINE = 8  # bytes of a line with a frame
LONGEST_WRITTEN = 80  # bytes of a line, with a bus of 16 letters
MOST_NAMED, MOST_STEPS_NAMED = 12, 10
_HEADS = (
    (LOG, re.compile(rb"\(\d{1,10}\.\d{3,9}\) +\S{1,16} +(?:[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#")),
    (
        TERMINAL,
        re.compile(
            rb"[ \t]*(?:\([-\d :]+\.\d{3,9}\) +)?[A-Za-z]\w{0,15} +(?:[RT]X(?: [-BE]){2} +)?"
            rb"(?:[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}) +\[\d{1,2}\]"
        ),
    ),
    (ASC, re.compile(rb"date [A-Z][a-z]{2} [^\n]*\n *base (?:hex|dec)", re.IGNORECASE)),
)
_BEFORE = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:[ \t]*\r?\n|#[^\n]*\n)*")
_LOCAL = re.compile(rb"[ \t]*\(\d{4}-")
_DECIMAL, _RELATIVE = (re.compile(words, re.IGNORECASE) for words in (rb"base +dec", rb"timestamps +relative"))
_ASC_DATE = re.compile(
    rb"(?:date|Begin Trigger ?block) +\w+ (\w{3})\w* +(\d+) +(\d+):(\d+):(\d+)(?:\.(\d+))? *([ap]m)? +(\d{4})",
    re.IGNORECASE,
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
OTHER_KINDS = {
    REQUEST: ("request", "requests"),
    ERROR: ("error frame", "error frames"),
    FD: ("frame of CAN FD", "frames of CAN FD"),
}
WITHOUT_TIMES = "Record it with candump -l, or let the device send its sample time."


def form_of(head: bytes) -> int | None:
    """Form of a log by its first lines; None if it is not one."""
    text = _BEFORE.sub(b"", head)
    return next((form for form, pattern in _HEADS if pattern.match(text)), None)


class CanLog(MessageFile):
    """A log.

    Raises:
        RecordingError: no device in it is known, or it has no times.
    """

    def __init__(self, request: OpenRequest) -> None:
        super().__init__(request.path)
        self.format = "can"
        with open_regular(self.path) as file:
            head = _BEFORE.sub(b"", file.read(HEAD_BYTES))
        form = form_of(head)
        assert form is not None
        if form == ASC and _DECIMAL.search(head):
            raise RecordingError(f"{self.path.name} has decimal numbers.", "Save it with hexadecimal ones (base hex).")
        self._form = form
        survey = LogSurvey()
        for data, table, odd, _ in self._lines():
            survey.odd += odd
            survey.add(data, table)
        if not survey.rows:
            raise RecordingError(f"{self.path.name} has no frames of CAN.", "Give a log of candump, or an ASC file.")
        self._known = self._recognised(survey, request)
        keys = {name: key for key, name in survey.buses.items()}
        self._buses = [keys[one.bus] for one in self._known]
        self._since: Since = survey.since(is_relative=form == ASC and _RELATIVE.search(head) is not None)
        self.timed = self._since != "none"
        self._steps = survey.back if self._since in ("1970", "start") else []
        self._origin = 0
        dated = self._dated(survey, head)
        self.damage = [remark(words) for words in (*dated, *self._step_words(), *self._left_out(survey))]
        if survey.odd:
            some = counted(survey.odd, "line has no frame and was", "lines have no frames and were")
            self.damage.append(FileDamage(-1, f"{some} left out."))
        several = len(self._known) > 1
        self.devices = {
            str(number): SourceDevice(
                str(number),
                "can",
                {
                    "source": self.path.name,
                    "name": f"{self.path.stem} {one.bus}" if several else self.path.stem,
                    "link": "file",
                    "product": one.title,
                },
            )
            for number, one in enumerate(self._known, 1)
        }

    def _lines(self) -> Iterator[tuple[Bytes, Ints, int, float]]:
        """Blocks of the file: bytes, table of the frames in them, number of odd lines, share of the file read."""
        size, done, held = max(self.path.stat().st_size, 1), 0, b""
        table = np.empty((LINE, min(size, BLOCK_BYTES) // LEAST_LINE + 1), np.int64)
        with open_regular(self.path) as file:
            while True:
                data = file.read(BLOCK_BYTES)
                done += len(data)
                held += data
                cut = held.rfind(b"\n") + 1 if data and len(held) < 2 * BLOCK_BYTES else len(held)
                block, at = np.frombuffer(held[:cut], np.uint8), 0
                held = held[cut:]
                while at < cut:
                    n, at, odd = read_lines(block, at, self._form, table)
                    usual = ~strays(table[STAMP, :n])
                    frames = table[:, :n] if usual.all() else np.ascontiguousarray(table[:, :n][:, usual])
                    yield block, frames, odd + n - frames.shape[1], min(done / size, 1.0)
                if not data:
                    return

    # -- what it is ----------------------------------------------------------------------------------------------------

    def _recognised(self, survey: LogSurvey, request: OpenRequest) -> list[CanDevice]:
        log = list(survey.identifiers.values())
        try:
            known = devices_of(log, request.table.columns)
        except ValueError as error:
            raise RecordingError(f"{self.path.name}: {error}.", "Name one of these messages.") from None
        if not known:
            listed = ", ".join(f"{one.bus} {identifier_text(one.number)}" for one in log[:MOST_NAMED])
            more = f" and {len(log) - MOST_NAMED} more" if len(log) > MOST_NAMED else ""
            frames, kinds = counted(survey.rows, "frame"), counted(len(log), "identifier")
            words = (
                f"{self.path.name} is a log of CAN with {frames} and {kinds} ({listed}{more}), none of a known device."
            )
            some = ", ".join(message_names()[6:8])
            hint = f"Name changed identifiers in a file of --columns: lines such as 123 = Quaternion ({some}, …)."
            raise RecordingError(words, hint)
        return known

    def _left_out(self, survey: LogSurvey) -> Iterator[str]:
        used = {(one.bus, number) for one in self._known for number in one.definition.rows}
        rest = [one for one in survey.identifiers.values() if (one.bus, one.number) not in used]
        if rest:
            rest.sort(key=lambda one: -one.frames)
            listed = ", ".join(f"{one.bus} {identifier_text(one.number)} ({one.frames})" for one in rest[:MOST_NAMED])
            frames, kinds = counted(sum(one.frames for one in rest), "frame"), counted(len(rest), "other identifier")
            yield f"{frames} of {kinds} left out: {listed}{', …' if len(rest) > MOST_NAMED else ''}."
        others = [counted(survey.kinds[kind], *words) for kind, words in OTHER_KINDS.items() if survey.kinds[kind]]
        if others:
            yield f"Left out: {', '.join(others)}."

    # -- times ---------------------------------------------------------------------------------------------------------

    def _dated(self, survey: LogSurvey, head: bytes) -> Iterator[str]:
        """Find the origin of the times, and say how."""
        if self._since == "1970":
            if self._form == TERMINAL and _LOCAL.match(head):
                yield "The log has local times (candump -t A) without their zone: they are taken for UTC."
            return
        words = {
            "none": "The log has no times: the clock of the device gives the spacing",
            "line": "The times of the log are those since the line before; they are added up",
            "start": "The times of the log are since its start",
        }[self._since]
        first = next((int(times[0]) for _, _, times, _, _ in self._timed() if len(times)), 0)
        if (utc := self._utc_of_device(survey)) is not None:
            self._origin, by = utc, "the UTC that the device sends"
        elif (begin := _asc_date(head)) is not None:
            self._origin, by = begin, "the head of the file, taken for UTC"
        else:
            clock = TableClock("the log", (), "number", "s", (1.0,), "start", "stated", "")
            seconds, by = origin_of(clock, first / SECOND_NS, TableFormat(0, ",", ".", (), (), 0), self.path)
            self._origin = round(seconds * 1e6) * 1000
        yield f"{words}. Their date is that of {by}."

    def _utc_of_device(self, survey: LogSurvey) -> int | None:
        """UTC at the origin of the times, by the first valid one that a device sends, ns."""
        for one in self._known:
            log = survey.of_bus(one.bus)
            for number, row in one.definition.rows.items():
                if row.role != "utc" or self._since == "none":
                    continue
                records = row.column(log[number].data)
                valid = np.flatnonzero((records["year"] >= EARLIEST_YEAR) & (utc_of_records(records) > 0))
                if len(valid):
                    at = int(valid[0])
                    return int(utc_of_records(records)[at] - log[number].stamps[at])
        return None

    def _sample_time(self) -> tuple[int, int, CanDevice]:
        """Bus and identifier of a clock of a device.

        Raises:
            RecordingError: none is sent.
        """
        for place, one in enumerate(self._known):
            for number, row in one.definition.rows.items():
                if row.role == "time":
                    return self._buses[place], number, one
        raise RecordingError(f"{self.path.name} has no times, and no clock of a device.", WITHOUT_TIMES)

    def _timed(self) -> Iterator[tuple[Bytes, Ints, Ints, int, float]]:
        """Blocks of the file: bytes, table, arrival of each frame in ns, row of the first, share of the file read."""
        rows = total = 0
        at = np.array([row for row, _ in self._steps], np.int64)
        shifts = np.concatenate(([0], np.cumsum([by for _, by in self._steps], dtype=np.int64)))
        ticks = self._ticks() if self._since == "none" else None
        for data, table, _, share in self._lines():
            count = table.shape[1]
            if ticks is not None:
                times = ticks(data, table)
            elif self._since == "line":
                times = total + np.cumsum(table[STAMP])
                total = int(times[-1]) if count else total
            else:
                times = np.array(table[STAMP])
            if len(at):
                times += shifts[np.searchsorted(at, np.arange(rows, rows + count), "right")]
            yield data, table, times + self._origin, rows, share
            rows += count

    def _ticks(self) -> Callable[[Bytes, Ints], Ints]:
        """Times of frames by the newest sample time before each."""
        bus, number, device = self._sample_time()
        tick_ns, unwrap = device.definition.tick_ns, TickUnwrapper(1 << 32)
        newest: int | None = None

        def times(data: Bytes, table: Ints) -> Ints:
            nonlocal newest
            is_clock = (table[BUS_KEY] == bus) & (table[ID] == number) & (table[SENDER] == DATA)
            which = np.flatnonzero(is_clock & (table[LENGTH] >= 4))
            rows = np.empty((len(which), FRAME_BYTES), np.uint8)
            payloads(data, table[BODY, which], table[LENGTH, which], rows)
            raw = np.ascontiguousarray(rows[:, :4]).view(">u4")[:, 0].astype(np.int64)
            known = unwrap.ticks(raw) * tick_ns
            first = newest if newest is not None else int(known[0]) if len(known) else 0
            newest = int(known[-1]) if len(known) else newest
            behind = np.searchsorted(which, np.arange(table.shape[1]), "right")
            return np.concatenate(([first], known))[behind]

        return times

    def _step_words(self) -> Iterator[str]:
        for row, by in self._steps[:MOST_STEPS_NAMED]:
            words = f"The clock of the log goes back by {duration_text(by / SECOND_NS)} at frame {row + 1}"
            yield f"{words}; the arrival continues there."
        if len(self._steps) > MOST_STEPS_NAMED:
            yield f"It goes back {len(self._steps) - MOST_STEPS_NAMED} more times."

    # -- the stream ----------------------------------------------------------------------------------------------------

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        for data, table, times, first, share in self._timed():
            count = table.shape[1]
            edges = [row - first for row, _ in self._steps if first <= row < first + count]
            for begin, end in pairwise([0, *(edge for edge in edges if edge), count]):
                back = next((by for row, by in self._steps if row == first + begin), 0)
                for place, one in enumerate(self._known):
                    step = 0 if any(row.role in ("time", "utc") for row in one.definition.rows.values()) else back
                    which = self._of_device(place, one, table, begin, end)
                    if len(which):
                        chosen = np.ascontiguousarray(table[:, which])
                        yield _block(str(place + 1), one, data, chosen, times[which], step, share)

    def _of_device(self, place: int, one: CanDevice, table: Ints, begin: int, end: int) -> Ints:
        """Rows of a part of a block that are frames of a device."""
        some = table[:, begin:end]
        numbers = np.array(sorted(one.definition.rows), np.int64)
        at = np.minimum(np.searchsorted(numbers, some[ID]), len(numbers) - 1)
        is_own = (some[SENDER] == DATA) & (some[BUS_KEY] == self._buses[place]) & (numbers[at] == some[ID])
        return np.flatnonzero(is_own) + begin


def _block(device: str, one: CanDevice, data: Bytes, table: Ints, times: Ints, step: int, share: float) -> ChunkBlock:
    """Frames of a device as lines, after its definition."""
    head = one.definition.line() + (step_line(-step) if step else b"")
    out, ends = np.empty(LONGEST_WRITTEN * len(times), np.uint8), np.empty(len(times), np.int64)
    size = write_lines(data, table, times, out, ends)
    text = head + out[:size].tobytes()
    return ChunkBlock(
        device, "rx", text, np.concatenate(([0], ends)) + len(head), np.concatenate((times[:1], times)), share
    )


def _asc_date(head: bytes) -> int | None:
    """Begin of an ASC log by its head, ns; None if it cannot be read."""
    match = next(reversed([*_ASC_DATE.finditer(head)]), None)  # that of the measurement follows that of the file
    if match is None or (name := match[1].decode().lower()) not in _MONTHS:
        return None
    hour = int(match[3])
    if match[7]:
        hour = hour % 12 + 12 * (match[7].lower() == b"pm")
    try:
        date = datetime(
            int(match[8]), _MONTHS.index(name) + 1, int(match[2]), hour, int(match[4]), int(match[5]), tzinfo=UTC
        )
    except ValueError:
        return None
    fraction = int((match[6] or b"0").ljust(9, b"0")[:9])
    return round(date.timestamp()) * SECOND_NS + fraction


register_reader(FileReader("can", "CAN log", (".asc",), CanLog, recognises=lambda head: form_of(head) is not None))
