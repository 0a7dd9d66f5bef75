"""Why are arrival times as uneven as they are, and what can be done about it?

    what is seen                                         what it is called     what helps
    ──────────────────────────────────────────────────   ───────────────────   ──────────────────────
    the device's clock starts again                      resets                its supply, its cable
    frames come late all at once, none of them lost      stalls                less load on this host
    delays spread evenly over some ms on a wired line    bursts                a latency timer of 1 ms
    delays of ms that thin out, or any over a network    network               a wire

One cause is named at a time, the one nearest the top; after a minute without it, it is history. Mapped device times
stay even whatever the cause: what suffers is how far off all of them may be, which the page shows as ±.
"""

from __future__ import annotations

from collections.abc import Sequence

from protocols.clock_sync import ClockSync
from server.wire import TimeCause

LATELY_S = 60.0
NETWORKS = ("tcp", "tcp-listen", "udp")
UNEVEN_NS = 2e6  # delays of a network that are worth a word
FEWEST = 100  # samples before anything is called a habit of the link
RULE = "imuscope doctor --udev-rule | sudo tee /etc/udev/rules.d/70-imuscope.rules"
PORT = "ttyUSB0"


def cause_of(clock: ClockSync, resets: Sequence[float], *, kind: str, port: str, now: float) -> TimeCause | None:
    """What makes the times of a device uneven, None where nothing does.

    Args:
        clock: of the device.
        resets: unix s at which it started again.
        kind: of its link (wire.DeviceInfo.link).
        port: what the kernel calls its port, "" where it has none.
        now: unix s.
    """
    again = sum(time > now - LATELY_S for time in resets)
    if again:
        often = "once" if again == 1 else f"{again} times"
        return TimeCause(
            "resets",
            f"The device's clock started again {often} in the last minute; its times are mapped anew from there.",
            "Check its supply and its cable: a device whose supply dips starts again.",
        )
    stalls = [late for arrival, late in clock.stalls if arrival / 1e9 > now - LATELY_S]
    if stalls:
        return _stall(stalls, kind)
    spread = clock.spread
    if clock.rows < FEWEST:
        return None
    if kind in NETWORKS:
        return _network(spread.top) if spread.top > UNEVEN_NS else None
    if spread.bursts:
        return _bursts(spread.top, clock.holds_ns, port or PORT)
    hides = clock.holds_ns > UNEVEN_NS and spread.hidden > UNEVEN_NS / 2
    return _timer(clock.holds_ns, port or PORT) if hides else None


def _stall(stalls: Sequence[float], kind: str) -> TimeCause:
    longest = max(stalls) / 1e9
    often = "" if len(stalls) == 1 else f", {len(stalls)} times in the last minute"
    if kind in NETWORKS:
        text = f"Nothing came over the network for {longest:.1f} s{often}, and then all at once."
        return TimeCause("stalls", text, "Is the radio link weak, or the other end busy? A wire helps.")
    text = f"This host did not read for {longest:.1f} s{often}: it was busy. No sample was lost by it."
    remedy = "Look with `top` for what loads it; `nice -n -5` or another core for this server helps."
    return TimeCause("stalls", text, remedy)


def _network(top_ns: float) -> TimeCause:
    text = f"The network delivers unevenly: samples come up to {top_ns / 1e6:.0f} ms late."
    return TimeCause("network", text, "Device times stay even. A wire instead of a radio link narrows the ±.")


def _bursts(top_ns: float, holds_ns: float, port: str) -> TimeCause:
    late = f"Samples arrive in bursts, up to {top_ns / 1e6:.0f} ms late"
    if 0 < holds_ns <= 1e6:
        text = f"{late}, although the latency timer of the USB adapter is 1 ms: something else gathers bytes."
        return TimeCause("bursts", text, "Connect the adapter without a hub, or the device by another port.")
    return TimeCause("bursts", f"{late}: the USB adapter gathers bytes until its latency timer runs out.", _set(port))


def _timer(holds_ns: float, port: str) -> TimeCause:
    """All frames are late by nearly the same: that is known of the adapter, and not seen in the times."""
    text = f"The USB adapter may keep every sample back, for up to {holds_ns / 1e6:.0f} ms: its latency timer."
    return TimeCause("bursts", text, _set(port))


def _set(port: str) -> str:
    timer = f"/sys/bus/usb-serial/devices/{port}/latency_timer"
    return f"Set the timer to 1 ms: `echo 1 | sudo tee {timer}`; for good: `{RULE}`."
