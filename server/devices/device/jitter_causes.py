"""Causes of uneven arrival times, and remedies. A cause that nothing measured proves is called possible.

    observation                                          name                  remedy
    ──────────────────────────────────────────────────   ───────────────────   ──────────────────────
    the device's clock restarts                          resets                its supply, its cable
    frames arrive late all at once                       stalls                less load at either end
    the same, and this process did not run               stalls                less load on this host
    delays spread evenly over some ms on a wired line    bursts                a latency timer of 1 ms
    delays of ms that thin out, or any over a network    network               a wire

One cause is reported at a time, the topmost; it is dropped after a minute without it. Mapped device times stay even
whatever the cause; only their common uncertainty grows, which the page shows as ±.
"""

from collections.abc import Sequence

from imuscope.protocols.clocks.clock_sync import ClockSync
from imuscope.server.links.registry import is_network
from imuscope.server.wire import JitterCause

LATELY_S = 60.0
NOTICEABLE_NS = 2e6  # network delays that are reported
MIN_SAMPLES = 100  # samples before a cause is attributed to the link
RULE = "imuscope doctor --udev-rule | sudo tee /etc/udev/rules.d/70-imuscope.rules"
PORT = "ttyUSB0"
Span = tuple[float, float]


def cause_of(
    clock: ClockSync, resets: Sequence[float], *, kind: str, port: str, now: float, pauses: Sequence[Span] = ()
) -> JitterCause | None:
    """Cause of uneven arrival times of a device; None if they are even.

    Args:
        clock: clock mapping of the device.
        resets: times of its resets, unix s.
        kind: of its link (wire.DeviceInfo.link).
        port: name of its port in the kernel, "" if it has none.
        now: unix s.
        pauses: when this process did not run, unix s.
    """
    reset_count = sum(time > now - LATELY_S for time in resets)
    if reset_count:
        often = "once" if reset_count == 1 else f"{reset_count} times"
        return JitterCause(
            "resets",
            f"The device's clock restarted {often} in the last minute; the mapping of its times restarts there.",
            "If it was not restarted on purpose, and nothing set its clock, check its supply and its cable.",
        )
    stalls = [(late / 1e9, arrival / 1e9) for arrival, late in clock.stalls if arrival / 1e9 > now - LATELY_S]
    if stalls:
        return _stall(stalls, kind, pauses)
    spread = clock.spread
    if clock.rows < MIN_SAMPLES:
        return None
    if is_network(kind):
        return _network(spread.top) if spread.top > NOTICEABLE_NS else None
    if spread.bursts:
        return _bursts(spread.top, clock.holds_ns, port or PORT)
    hides = clock.holds_ns > NOTICEABLE_NS and spread.hidden > NOTICEABLE_NS / 2
    return _timer(clock.holds_ns, port or PORT) if hides else None


def _stall(stalls: Sequence[Span], kind: str, pauses: Sequence[Span]) -> JitterCause:
    longest, end = max(stalls)
    often = "" if len(stalls) == 1 else f", {len(stalls)} times in the last minute"
    text = f"Nothing was read for {longest:.1f} s{often}, then all at once: "
    asleep = sum(max(0.0, min(until, end) - max(since, end - longest)) for since, until in pauses)
    if asleep > longest / 2:
        remedy = "Check its load with `top`; run this server with `nice -n -5` or on another core."
        return JitterCause("stalls", f"{text}this host did not run the server in that time.", remedy)
    if is_network(kind):
        remedy = "Check the radio link and the load of both ends, or use a cable."
        return JitterCause("stalls", f"{text}the network or either end may have paused.", remedy)
    remedy = "Check the load of this host with `top`, and the adapter."
    return JitterCause("stalls", f"{text}the device, its adapter or this host may have paused.", remedy)


def _network(top_ns: float) -> JitterCause:
    text = f"Samples arrive unevenly over the network, up to {top_ns / 1e6:.0f} ms late."
    return JitterCause("network", text, "Device times stay even. A cable instead of a radio link may reduce the ±.")


def _bursts(top_ns: float, holds_ns: float, port: str) -> JitterCause:
    late = f"Samples arrive in bursts, up to {top_ns / 1e6:.0f} ms late"
    if 0 < holds_ns <= 1e6:
        text = f"{late}, although the latency timer of the USB adapter is 1 ms: bytes may be buffered elsewhere."
        return JitterCause("bursts", text, "Connect the adapter without a hub, or the device to another port.")
    timer = f"its latency timer of {holds_ns / 1e6:.0f} ms" if holds_ns else "a latency timer"
    return JitterCause("bursts", f"{late}: a USB adapter may hold them until {timer} expires.", _set(port))


def _timer(holds_ns: float, port: str) -> JitterCause:
    """All frames are late by nearly the same time, which follows from the adapter's timer but is not visible."""
    text = f"The USB adapter may delay every sample by up to {holds_ns / 1e6:.0f} ms: its latency timer."
    return JitterCause("bursts", text, _set(port))


def _set(port: str) -> str:
    timer = f"/sys/bus/usb-serial/devices/{port}/latency_timer"
    return f"Set the timer to 1 ms: `echo 1 | sudo tee {timer}`; permanently: `{RULE}`."
