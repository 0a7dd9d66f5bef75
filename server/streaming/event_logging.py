"""Which of what happens in a server is worth a line in its log?

    hub: events        link lost and back, gaps, refused frames, clocks, what was written to a device
    hub: devices       a device is there; it said who it is
    hub: control       a job on a device began, and how it ended
    hub: recorder      a recording began, ended, failed

Frames one by one (commands, answers, lines of text) are for --log-level debug. Browsers and refused requests
are told where they are met (server/api/websocket.py, server/auth.py), in the same form (server/logging_setup.py).
"""

from __future__ import annotations

import logging
from typing import Any

from server import wire
from server.streaming.hub import Hub

log = logging.getLogger("imuscope.journal")

LEVELS = {"info": logging.INFO, "caution": logging.WARNING, "fault": logging.ERROR}
CHATTER = ("reply", "text", "command")  # what a command was for is told by its job
OFTEN = ("gap", "reject", "clock")  # a bad cable brings many a second
_ENDED = {"done": logging.INFO, "stopped": logging.INFO, "failed": logging.WARNING}


class EventLogger:
    """Listens to a hub for as long as that lives."""

    def __init__(self, hub: Hub) -> None:
        self._devices: dict[str, tuple[str, ...]] = {}
        self._jobs: dict[str, dict[int, str]] = {}
        self._recorder = wire.RecorderState(running=False)
        hub.heard_event.add(self.event)
        hub.heard_device.add(self.device)
        hub.heard_control.add(self.control)
        hub.heard_recorder.add(self.recorder)

    def event(self, event: wire.EventInfo) -> None:
        """An entry of the event log."""
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
        """Something about a device changed; of interest is who it is."""
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

    def control(self, state: wire.ControlState) -> None:
        """What is done to a device changed."""
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
        """What is recorded changed; told twice a second while something is."""
        before, self._recorder = self._recorder, state
        data = {"recording": state.id, "devices": state.devices, "bytes": state.bytes}
        if state.running and (not before.running or before.started != state.started):
            _write(logging.INFO, "recording", "", f"Recording {state.id} began: {len(state.devices)} devices.", data)
        elif before.running and not state.running and not state.message:  # why it failed is an event
            _write(logging.INFO, "recording", "", f"Recording {state.id} ended: {state.bytes / 1e6:.1f} MB.", data)


def _write(level: int, event: str, device: str, text: str, data: dict[str, Any], *, often: bool = False) -> None:
    key = (event, device) if often else None
    log.log(level, "%s", text, extra={"event": event, "device": device, "data": data, "often": key})
