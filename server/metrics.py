"""Which figures does this server tell a Prometheus? All that a page shows, and those of the process itself.

    per link       bytes, frames, rejects by reason, gaps, lost samples, latency; clock: jitter, drift, uncertainty
    per browser    lag, bytes sent, bytes waiting, samples dropped
    recording      running, bytes, how far behind the disk is; free space of the data folder; exports
    process        memory, processor time, open files, start, uptime, version

Labels: `device` is the page's id ("1"; of a further device on the link of 1, "1.102"); what it is called stands once,
in imuscope_device_info, to be joined. What a link counts (bytes, rejects, latency) is told of its first device only, so
that a sum over devices counts nothing twice. `client` is the number of a browser's connection in this run.

Asking changes nothing and costs a millisecond; it is answered from figures that are kept anyway.
"""

from __future__ import annotations

import os
import platform
import shutil
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from server import wire
from server.devices.session import Session
from server.prometheus_text import PrometheusText
from server.streaming.hub import Hub
from server.streaming.send_queue import SendQueue
from server.version import VERSION

STATES = get_args(wire.DeviceStatus)
_PROC = Path("/proc/self")


@dataclass(frozen=True, slots=True)
class Sources:
    """Where the figures are."""

    hub: Hub
    sessions: Iterable[Session]
    recorder: wire.RecorderState
    exports: Iterable[wire.ExportJob]
    data: Path


class Metrics:
    """The figures of one server.

    Args:
        hub: whose events are counted from here on.
    """

    def __init__(self, hub: Hub) -> None:
        self._events: Counter[tuple[str, str]] = Counter()
        self._started = time.monotonic()
        hub.heard_event.add(self._event)

    def _event(self, event: wire.EventInfo) -> None:
        self._events[event.kind, event.level] += 1

    def text(self, sources: Sources) -> str:
        """The page for Prometheus. In the event loop: it reads what only that thread may change."""
        page = PrometheusText()
        page.family("imuscope_build_info", "gauge", "Always 1; what is running.")
        page.add(1, version=VERSION, python=platform.python_version(), machine=platform.machine(), run=sources.hub.run)
        page.family("imuscope_uptime_seconds", "gauge", "Since this server was put together.")
        page.add(time.monotonic() - self._started)
        _devices(page, sources.hub.devices.values())
        _links(page, list(sources.sessions), sources.hub.now())
        _clients(page, sources.hub)
        _recording(page, sources)
        page.family("imuscope_events_total", "counter", "Entries of the event log, by kind and level.")
        for (kind, level), count in sorted(self._events.items()):
            page.add(count, kind=kind, level=level)
        _process(page)
        return str(page)


def _devices(page: PrometheusText, infos: Iterable[wire.DeviceInfo]) -> None:
    infos = list(infos)
    page.family("imuscope_device_info", "gauge", "Always 1; what a device is, and on which link.")
    for info in infos:
        labels = {name: getattr(info, name) for name in ("name", "source", "link", "protocol", "product")}
        page.add(1, device=info.id, **labels, serial_number=info.serial_number, firmware=info.firmware)
    page.family("imuscope_device_state", "gauge", "1 for the state that a device is in, 0 for the others.")
    for info in infos:
        for state in STATES:
            page.add(int(info.status == state), device=info.id, state=state)


def _links(page: PrometheusText, sessions: list[Session], now: float) -> None:
    every = [health for session in sessions for health in session.healths(now)]
    first = [session.health(now) for session in sessions]

    page.family("imuscope_link_received_bytes_total", "counter", "Bytes that came over a link.")
    for health in first:
        page.add(health.bytes, device=health.device)
    words = "Bytes that came faster than they could be decoded, and were dropped; a recording has them."
    page.family("imuscope_link_left_out_bytes_total", "counter", words)
    for session in sessions:
        page.add(session.left_out, device=session.info.id)
    page.family("imuscope_link_capacity_bytes_per_second", "gauge", "Bytes that a link can carry, where that is known.")
    for health in first:
        page.add(health.capacity, device=health.device)
    page.family("imuscope_link_frames_total", "counter", "Frames that were decoded, by message.")
    for health in every:
        for message in health.messages:
            page.add(message.count, device=health.device, message=message.name)
    page.family("imuscope_link_rejects_total", "counter", "Candidates for frames that were refused, by reason.")
    for health in first:
        for reason, count in sorted(health.rejects_by.items()):
            page.add(count, device=health.device, reason=reason)
    page.family("imuscope_link_gaps_total", "counter", "Holes in a device's counters.")
    for health in every:
        page.add(health.gaps, device=health.device)
    page.family("imuscope_link_lost_samples_total", "counter", "Samples that a device's counters say are missing.")
    for health in every:
        page.add(health.lost, device=health.device)
    page.family("imuscope_link_unverified_samples_total", "counter", "Samples whose frames could not be checked.")
    for health in every:
        page.add(health.unverified, device=health.device)
    words = "From the arrival of the oldest waiting byte until its samples are handed to the browsers."
    page.family("imuscope_link_latency_seconds", "histogram", words)
    for session in sessions:
        page.histogram(session.latency, device=session.info.id)
    page.family("imuscope_link_last_arrival_timestamp_seconds", "gauge", "When something came last, Unix time.")
    for health in every:
        page.add(health.last_arrival, device=health.device)
    _clocks(page, every)


def _clocks(page: PrometheusText, every: Iterable[wire.DeviceHealth]) -> None:
    every = list(every)
    page.family("imuscope_clock_jitter_seconds", "gauge", "p99 of arrival against expected arrival, lately.")
    for health in every:
        page.add(None if health.jitter_ms is None else health.jitter_ms / 1e3, device=health.device)
    page.family("imuscope_clock_drift_ratio", "gauge", "Device clock against this host's; 1e-6 is 1 ppm.")
    for health in every:
        page.add(None if health.drift_ppm is None else health.drift_ppm / 1e6, device=health.device)
    page.family("imuscope_clock_uncertainty_seconds", "gauge", "± of device time mapped to this host's.")
    for health in every:
        page.add(None if health.uncertainty_ms is None else health.uncertainty_ms / 1e3, device=health.device)


def _clients(page: PrometheusText, hub: Hub) -> None:
    now = hub.now()
    boxes: list[SendQueue] = sorted(hub.outboxes, key=lambda box: box.number)
    page.family("imuscope_clients", "gauge", "Browsers that are connected.").add(hub.browsers)
    page.family("imuscope_clients_connected_total", "counter", "Browsers that have connected.").add(hub.connected)
    words = "Samples dropped for browsers that did not keep up, those that have gone included."
    page.family("imuscope_dropped_samples_total", "counter", words)
    page.add(hub.gone_dropped + sum(box.dropped for box in boxes))
    page.family("imuscope_sent_bytes_total", "counter", "Bytes sent to browsers, those that have gone included.")
    page.add(hub.gone_bytes + sum(box.sent_bytes for box in boxes))
    page.family("imuscope_client_lag_seconds", "gauge", "Age of the oldest that a browser has not taken.")
    for box in boxes:
        page.add(box.lag(now), client=str(box.number))
    page.family("imuscope_client_dropped_samples_total", "counter", "Samples dropped for this browser.")
    for box in boxes:
        page.add(box.dropped, client=str(box.number))
    page.family("imuscope_client_sent_bytes_total", "counter", "Bytes sent to this browser.")
    for box in boxes:
        page.add(box.sent_bytes, client=str(box.number))
    page.family("imuscope_client_waiting_bytes", "gauge", "Live samples that wait for this browser.")
    for box in boxes:
        page.add(box.live_bytes, client=str(box.number))


def _recording(page: PrometheusText, sources: Sources) -> None:
    state = sources.recorder
    page.family("imuscope_recording_running", "gauge", "1 while something is recorded.").add(int(state.running))
    words = "1 when the last recording ended by itself: a full disk, a folder that is gone."
    page.family("imuscope_recording_failed", "gauge", words).add(int(bool(state.message) and not state.running))
    page.family("imuscope_recording_bytes", "gauge", "Size of the recording under way, over all its parts.")
    page.add(state.bytes if state.running else None)
    page.family("imuscope_recording_lag_seconds", "gauge", "Age of the oldest byte not yet on its way to the disk.")
    page.add(state.behind_s if state.running else None)
    page.family("imuscope_recording_seconds_left", "gauge", "Until the disk is full, at this rate.")
    page.add(state.seconds_left)
    page.family("imuscope_data_free_bytes", "gauge", "Free space where the data folder is.").add(_free(sources.data))
    states = Counter(job.state for job in sources.exports)
    page.family("imuscope_exports", "gauge", "Exports that run, wait, or wait to be fetched, by state.")
    for name in ("waiting", "running", "done", "failed", "cancelled"):
        page.add(states[name], state=name)


def _free(data: Path) -> int | None:
    for folder in (data, *data.parents):  # before anything is kept, its folder is not there
        try:
            return shutil.disk_usage(folder).free
        except FileNotFoundError:
            continue
        except OSError:
            return None
    return None


def _process(page: PrometheusText) -> None:
    """The usual names of every client of Prometheus; what a system does not tell is left out."""
    used = os.times()
    page.family("process_cpu_seconds_total", "counter", "Processor time, user and system, all threads.")
    page.add(used.user + used.system)
    try:
        stat = (_PROC / "stat").read_text().rsplit(")", 1)[1].split()
        boot = next(line for line in Path("/proc/stat").read_text().splitlines() if line.startswith("btime"))
        open_files = len(os.listdir(_PROC / "fd"))
    except (OSError, StopIteration):
        return
    page.family("process_start_time_seconds", "gauge", "When the process started, Unix time.")
    page.add(int(boot.split()[1]) + int(stat[19]) / os.sysconf("SC_CLK_TCK"))
    page.family("process_virtual_memory_bytes", "gauge", "Address space.").add(int(stat[20]))
    page.family("process_resident_memory_bytes", "gauge", "Memory in RAM.")
    page.add(int(stat[21]) * os.sysconf("SC_PAGE_SIZE"))
    page.family("process_open_fds", "gauge", "Open files and sockets.").add(open_files)
