"""Diagnostics of a device as diagnostic_msgs/DiagnosticArray: its link, rates, losses, and how well its clock is known.

    level    0 OK, 1 WARN: losses, rejects, a time that is uncertain, no figures yet, decoding behind the received bytes
             2 ERROR: no data, 3 STALE: no message for long

The uncertainty of stamps is among the values: ± of the mapping from the device's time to the host's, ms.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.server.extensions.ros2.type_support import message_class, serialize

ARRAY, STATUS, VALUE = (f"diagnostic_msgs/msg/{name}" for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue"))
OK, WARN, ERROR, STALE = range(4)
UNCERTAIN_MS = 20.0
BEHIND_S = 0.5  # as on the page
LEVELS = {"live": OK, "connecting": WARN, "idle": WARN, "lost": ERROR, "denied": ERROR, "ended": STALE}


@dataclass(frozen=True, slots=True)
class DiagnosticCounts:
    """Counts of problems at the last message, so that new ones can be distinguished from old ones."""

    lost: int = 0
    rejects: int = 0


def diagnostics(
    name: str, device: Mapping[str, Any], health: Mapping[str, Any] | None, last: DiagnosticCounts, time_ns: int
) -> tuple[bytes, DiagnosticCounts]:
    """The message, and the counts to give next time.

    Args:
        name: of the node.
        device, health: as in server/wire/ DeviceInfo and DeviceHealth; no health before the first figures.
    """
    figures = health or {}
    level = LEVELS.get(str(device["status"]), WARN)
    counts = DiagnosticCounts(int(figures.get("lost") or 0), int(figures.get("rejects") or 0))
    uncertainty = figures.get("uncertainty_ms")
    words = [str(device.get("message") or "")] if level != OK else []
    if level == OK:
        if counts.lost > last.lost:
            words.append(f"{counts.lost - last.lost} samples lost.")
        if counts.rejects > last.rejects:
            words.append(f"{counts.rejects - last.rejects} frames rejected.")
        if uncertainty is not None and uncertainty > UNCERTAIN_MS:
            words.append(f"Stamps are uncertain by ± {uncertainty:.0f} ms.")
        if (behind := (figures.get("behind") or {}).get("decoding", 0.0)) > BEHIND_S:
            words.append(f"Decoding is {behind:.3g} s behind the data received.")
        if health is None:
            words.append("No figures yet.")
        level = WARN if words else OK
    text = " ".join(filter(None, words)) or f"{str(device['status']).capitalize()}, {figures.get('rate') or 0:.1f} Hz"
    values = {
        "status": device["status"],
        "source": device.get("source"),
        "simulated": device.get("simulated") or None,
        "product": device.get("product"),
        "firmware": device.get("firmware"),
        "rate_hz": _rounded(figures.get("rate"), 2),
        "bytes_per_s": _rounded(figures.get("bytes_per_s"), 0),
        "samples_lost": figures.get("lost"),
        "gaps": figures.get("gaps"),
        "frames_rejected": figures.get("rejects"),
        "jitter_ms": _rounded(figures.get("jitter_ms"), 3),
        "clock_drift_ppm": _rounded(figures.get("drift_ppm"), 3),
        "clock_drift_uncertainty_ppm": _rounded(figures.get("drift_bound_ppm"), 3),
        "stamp_uncertainty_ms": _rounded(uncertainty, 3),
        "stamp_uncertainty_holds": figures.get("time_presumes") or None,
        **{f"rate_hz.{one['name']}": _rounded(one["rate"], 2) for one in figures.get("messages", ())},
        **{f"frames_rejected.{reason}": count for reason, count in figures.get("rejects_by", {}).items()},
    }
    return _array(name, level, text, str(device.get("serial_number") or ""), values, time_ns), counts


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _array(name: str, level: int, text: str, hardware: str, values: Mapping[str, Any], time_ns: int) -> bytes:
    pair = message_class(VALUE)
    status = message_class(STATUS)(
        level=level,
        name=f"imuscope: {name}",
        message=text,
        hardware_id=hardware,
        values=[pair(key=key, value=str(value)) for key, value in values.items() if value not in (None, "")],
    )
    time = message_class("builtin_interfaces/msg/Time")(sec=time_ns // 1_000_000_000, nanosec=time_ns % 1_000_000_000)
    header = message_class("std_msgs/msg/Header")(stamp=time, frame_id="")
    return serialize(message_class(ARRAY)(header=header, status=[status]), ARRAY)
