"""Log lines for events.

    bus: events        link lost and restored, gaps, rejected frames, clocks, writes to a device
    bus: devices       new devices, and their identity
    bus: jobs          start and result of a job on a device
    bus: recorder      a recording started, ended, failed

Single frames (commands, answers, lines of text) are logged with --log-level debug only. Browsers and refused requests
are logged in server/api/websocket.py and server/access/auth.py, in the same form (server/settings/logging_setup.py).
"""

import logging
from typing import Any

from imuscope.server import wire
from imuscope.server.streaming.bus import TelemetryBus

log = logging.getLogger("imuscope.journal")

LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}
CHATTER = ("reply", "text", "command")  # the purpose of a command is in the log of its job
OFTEN = ("gap", "reject", "clock")  # a bad cable causes many per second
_ENDED = {"done": logging.INFO, "stopped": logging.INFO, "failed": logging.WARNING}


class EventLogger:
    """Logs events of a bus, for as long as the server runs."""

    def __init__(self, bus: TelemetryBus) -> None:
        self._devices: dict[str, tuple[str, ...]] = {}
        self._jobs: dict[str, dict[int, str]] = {}
        self._recorder = wire.RecorderState(running=False)
        bus.events.subscribe(self.event)
        bus.devices.subscribe(self.device)
        bus.removed.subscribe(self.removed)
        bus.jobs.subscribe(self.job_report)
        bus.recorder.subscribe(self.recorder)

    def event(self, event: wire.EventInfo) -> None:
        """Log an entry of the event log."""
        level = LEVELS[event.level]
        if event.kind in CHATTER:
            level = logging.DEBUG
        data: dict[str, Any] = dict(event.data)
        if event.samples:
            data["samples"] = event.samples
        hint = data.get("hint")
        text = f"{event.text} {hint}" if isinstance(hint, str) and hint else event.text
        _write(level, event.kind, event.device, text, data, often=event.kind in OFTEN)

    def device(self, info: wire.DeviceInfo) -> None:
        """Log a change of a device's identity."""
        who = (info.product, info.serial_number, info.firmware)
        before = self._devices.get(info.id)
        self._devices[info.id] = who
        if before is None:
            text = f"{info.source} is device {info.id}."
            _write(logging.INFO, "device", info.id, text, {"source": info.source, "link": info.link})
        if who != (before or ("", "", "")) and any(who):
            parts = [info.product or info.name]
            parts += [f"serial number {info.serial_number}"] if info.serial_number else []
            parts += [f"firmware {info.firmware}"] if info.firmware else []
            named = zip(("product", "serial_number", "firmware"), who, strict=True)
            _write(logging.INFO, "identified", info.id, f"This is {', '.join(parts)}.", dict(named))

    def removed(self, device: str) -> None:
        """Forget a device that was removed."""
        self._devices.pop(device, None)
        self._jobs.pop(device, None)

    def job_report(self, state: wire.DeviceJobs) -> None:
        """Log a change of a device's jobs."""
        known = self._jobs.get(state.device, {})
        now: dict[int, str] = {}
        for job in (*reversed(state.done), *([state.running] if state.running is not None else [])):
            if job.id in now or known.get(job.id) == job.state:
                now[job.id] = job.state
                continue
            now[job.id] = job.state
            data = {"job": job.id, "title": job.title, "state": job.state}
            if job.state == "running":
                _write(logging.INFO, "job", state.device, f"Job {job.id}, {job.title}, began.", data)
            elif job.state in _ENDED:
                words = f"Job {job.id}, {job.title}: {job.message or job.state} {job.hint}".rstrip()
                _write(_ENDED[job.state], "job", state.device, words, data)
        self._jobs[state.device] = now

    def recorder(self, state: wire.RecorderState) -> None:
        """Log a change of the recorder; called twice a second while it runs."""
        before, self._recorder = self._recorder, state
        data = {"recording": state.id, "devices": state.devices, "bytes": state.bytes}
        if state.running and (not before.running or before.started != state.started):
            _write(logging.INFO, "recording", "", f"Recording {state.id} began: {len(state.devices)} devices.", data)
        elif before.running and not state.running and not state.message:  # a failure is logged as an event
            _write(logging.INFO, "recording", "", f"Recording {state.id} ended: {state.bytes / 1e6:.1f} MB.", data)


def _write(level: int, event: str, device: str, text: str, data: dict[str, Any], *, often: bool = False) -> None:
    key = (event, device) if often else None
    log.log(level, "%s", text, extra={"event": event, "device": device, "data": data, "often": key})
