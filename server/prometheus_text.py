"""How are figures written for Prometheus? Families of samples, one line each, in its text form 0.0.4.

    # HELP imuscope_link_rejects_total Candidates for frames that failed their checks, by reason.
    # TYPE imuscope_link_rejects_total counter
    imuscope_link_rejects_total{device="1",reason="bad_checksum"} 3

The rules: a family stands in one piece; HELP and TYPE come once, before its samples; label values escape \\, " and the
end of a line; a counter's name ends in _total, a unit is a base unit (seconds, bytes, ratio) and stands in the name. A
histogram is the cumulative counts of its buckets, the last of them +Inf, then _sum and _count.

This is the whole of what the official client would do here, without its import (60 ms of a live server's event loop);
the tests read what it gives with the official parser.

Source: Prometheus documentation, "Exposition formats" and "Metric and label naming".
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from typing import Literal

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Kind = Literal["counter", "gauge", "histogram"]


class Histogram:
    """How often something took how long.

    Args:
        bounds: upper edges of the buckets, ascending; beyond the last is +Inf.
    """

    __slots__ = ("bounds", "counts", "sum")

    def __init__(self, bounds: Sequence[float]) -> None:
        self.bounds = tuple(bounds)
        self.counts = [0] * (len(self.bounds) + 1)
        self.sum = 0.0

    def add(self, value: float) -> None:
        """One more."""
        self.counts[bisect_left(self.bounds, value)] += 1
        self.sum += value


class PrometheusText:
    """Text in the making: `family` opens one, `add` puts a sample into it. A family without samples is not written."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._head = ""
        self._name = ""

    def family(self, name: str, kind: Kind, help_: str) -> PrometheusText:
        """From here on samples are of this family."""
        self._name = name
        words = help_.replace("\\", "\\\\").replace("\n", "\\n")
        self._head = f"# HELP {name} {words}\n# TYPE {name} {kind}"
        return self

    def add(self, value: float | None, **labels: str) -> None:
        """A sample; None is none: what is not known is not written as 0."""
        if value is not None:
            self._line("", value, labels.items())

    def histogram(self, found: Histogram, **labels: str) -> None:
        """All samples of a histogram."""
        count = 0
        for bound, more in zip((*found.bounds, float("inf")), found.counts, strict=True):
            count += more
            self._line("_bucket", count, [*labels.items(), ("le", _number(bound))])
        self._line("_sum", found.sum, labels.items())
        self._line("_count", count, labels.items())

    def __str__(self) -> str:
        return "\n".join([*self._lines, ""])

    def _line(self, suffix: str, value: float, labels: Iterable[tuple[str, str]]) -> None:
        if self._head:
            self._lines.append(self._head)
            self._head = ""
        told = ",".join(f'{name}="{_escaped(text)}"' for name, text in labels)
        self._lines.append(f"{self._name}{suffix}{'{' + told + '}' if told else ''} {_number(value)}")


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _number(value: float) -> str:
    if value != value:
        return "NaN"
    if value in (float("inf"), float("-inf")):
        return "+Inf" if value > 0 else "-Inf"
    return str(value) if isinstance(value, int) else repr(float(value))
