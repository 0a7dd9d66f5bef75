"""Repeated rejects are reported with exact counts, at growing intervals."""

from __future__ import annotations

from imuscope.protocols.events import RejectedFrame
from imuscope.server.devices.device.event_reporter import EventReporter
from imuscope.server.streaming.telemetry import Telemetry


def reports_of(reasons: list[str], *, rate: int = 10) -> tuple[list[tuple[float, int]], int]:
    """Times and counts of the reports; reasons[i] occurs `rate` times in second i ("": none)."""
    now = 1000.0
    telemetry = Telemetry.create(lambda: now)
    incidents = EventReporter(telemetry.bus, "1")
    results: list[tuple[float, int]] = []
    telemetry.bus.events.subscribe(lambda event: results.append((round(now - 1000.0, 1), event.samples)))
    incidents.tick(now)
    sent = 0
    for second, reason in enumerate(reasons):
        for tenth in range(10):
            now = 1000.0 + second + tenth / 10
            for _ in range(rate // 10 if reason else 0):
                incidents.rejects([RejectedFrame(0, 40, reason, round(now * 1e9))])
                sent += 1
            incidents.tick(now)
    return results, sent


def test_a_stale_event_is_not_repeated_every_second() -> None:
    results, sent = reports_of(["stale"] * 600 + [""] * 10)
    assert results[0][0] <= 1.1, "at once"
    assert len(results) < 20
    assert sum(count for _, count in results) == sent


def test_another_reason_is_reported_at_once() -> None:
    results, _ = reports_of(["stale"] * 100 + ["bad_hmac"] * 2)
    assert any(100 <= at <= 101.2 for at, _ in results)


def test_an_ended_event_is_reported_soon_and_reported_again_later() -> None:
    results, sent = reports_of(["stale"] * 3 + [""] * 57 + ["stale"] * 2 + [""] * 2)
    first = [one for one in results if one[0] < 50]
    assert first[-1][0] < 5
    assert sum(count for _, count in first) == 30
    assert any(60 < at <= 61.2 for at, _ in results)
    assert sum(count for _, count in results) == sent
