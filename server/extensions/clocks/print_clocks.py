"""`imuscope time FILE`: print every clock of a file, and which of them is the time axis.

    Gyroscope
      clock               unit  zero   rate      resolution  drift      jitter    steps  repeats  bursts
    * time                ns    1970   100 Hz    10 ms                            0      0        0 %
      seconds_elapsed     s     start  100 Hz    10 ms       +0.0 ppm   60 ns     0      0        0 %

The star marks the axis. Steps are listed below, with their size.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.tables.clocks.steps import duration_text
from imuscope.recordings.tables.dates import utc_text
from imuscope.recordings.tables.time_units import rate_text
from imuscope.server.commands.decoded import decoded
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.clocks.figures import FileClock, MessageClocks, as_json, clocks_of
from imuscope.server.library.axis_words import RECORDING_WORDS

HEADINGS = ("", "clock", "unit", "zero", "rate", "resolution", "drift", "jitter", "steps", "repeats", "bursts")
MIN_SHOWN_SHARE = 0.005  # of a share, in whole percents
PRESUMES = "± of a drift holds if the delay of neither clock grows or shrinks all along."
NOTHING_S = 1e-9  # below the resolution of a time since 1970
WORDS = {
    "back": "goes back by {} at sample {} ({})",
    "restart": "restarts: it goes back by {} at sample {} ({})",
    "ahead": "goes ahead by {} at sample {} ({})",
    "wrap": "wraps after {} at sample {} ({})",
}


def print_clocks(path: Path, reading: DecodeOptions, out: TextIO, notes: TextIO, *, text_format: str = "table") -> None:
    """Print the clocks of a file.

    Args:
        reading: decode options; without a protocol it is detected.
        notes: stream for the progress bar, and for the clock that is the time axis.
        text_format: "table" for people, "json" for programs.

    Raises:
        UsageError, RecordingError, DomainError: the file cannot be decoded.
    """
    with decoded(path, reading, notes, of_device=True) as store:
        if not store.manifest.get("time"):
            print(f"imuscope: {RECORDING_WORDS}", file=notes)
        if text_format == "json":
            out.write(json.dumps(as_json(store), ensure_ascii=False, allow_nan=False) + "\n")
        else:
            _print_table(store, out, notes)


def _print_table(store: ColumnStore, out: TextIO, notes: TextIO) -> None:
    messages = clocks_of(store)
    for number, message in enumerate(messages):
        out.write("\n" if number else "")
        out.write(f"{message.message}\n")
        _print_message(message, out)
    if any(clock.drift_error_ppm is not None for message in messages for clock in message.clocks):
        print(f"imuscope: {PRESUMES}", file=notes)


def _print_message(message: MessageClocks, out: TextIO) -> None:
    rows: list[Sequence[str]] = [HEADINGS, *map(_cells, message.clocks)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        out.write("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() + "\n")
    for clock in message.clocks:
        for step in clock.steps:
            words = WORDS[step.kind].format(duration_text(abs(step.by_s)), step.row, utc_text(step.time))
            out.write(f"  {clock.name} {words}\n")
        if clock.steps_in_all > len(clock.steps):
            out.write(f"  {clock.name}: {clock.steps_in_all - len(clock.steps)} more steps\n")


def _short(seconds: float) -> str:
    """A duration with the digits that mean something."""
    return duration_text(float(f"{seconds:.3g}")) if seconds >= NOTHING_S else "0"


def _drift_text(ppm: float | None, error: float | None) -> str:
    if ppm is None:
        return ""
    return f"{ppm:+.1f} ppm" if error is None else f"{ppm:+.1f} ±{error:.1f} ppm"


def _cells(clock: FileClock) -> Sequence[str]:
    return (
        "*" if clock.is_axis else "",
        clock.name,
        clock.unit,
        clock.epoch,
        rate_text(clock.rate_hz) if clock.rate_hz else "—",
        _short(clock.resolution_s) if clock.resolution_s else "—",
        _drift_text(clock.drift_ppm, clock.drift_error_ppm),
        "" if clock.jitter_s is None else _short(clock.jitter_s),
        str(clock.steps_in_all),
        str(clock.repeats),
        f"{100 * clock.bursts:.0f} %" + (f" of {clock.burst_samples:.3g}" if clock.bursts >= MIN_SHOWN_SHARE else ""),
    )
