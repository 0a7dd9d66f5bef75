"""Metrics for Prometheus: those that the page shows, and those of the process.

    per link       bytes, frames, rejects by reason, gaps, lost samples, latency; clock: jitter, drift, uncertainty
    per browser    lag, bytes sent, bytes waiting, samples dropped
    alarms         raised, without data, how often raised
    recording      running, bytes, lag of the disk; free space of the data folder; exports
    process        memory, processor time, open files, start, uptime, version

Labels: `device` is the page's id ("1"; of a further device on the link of 1, "1.102"); its name is in
imuscope_device_info only, for joins. Link counters (bytes, rejects, latency) are reported for the first device only, so
that a sum over devices counts nothing twice. `client` is the number of a browser's connection in this run.

A request changes nothing and takes about a millisecond, because all values exist already.
"""

import os
import platform
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from imuscope.server import wire
from imuscope.server.devices.link.session import Session
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.clients import ClientStatistics
from imuscope.server.text.prometheus import PrometheusText
from imuscope.server.version import VERSION

STATES = get_args(wire.DeviceStatus)
_PROC = Path("/proc/self")
LEVEL_LABELS = {"warning": "caution", "error": "fault"}
"""Existing alerts use these label values, so they stay as first published."""


@dataclass(frozen=True, slots=True)
class Sources:
    """Objects that the metrics are read from."""

    bus: TelemetryBus
    clients: ClientStatistics
    sessions: Iterable[Session]
    recorder: wire.RecorderState
    exports: Iterable[wire.ExportJob]
    data: Path
    others: Sequence[Callable[[PrometheusText], None]] = ()  # add the families of other services


class Metrics:
    """Metrics of one server.

    Args:
        bus: its events are counted from now on.
    """

    def __init__(self, bus: TelemetryBus) -> None:
        self._events: Counter[tuple[str, str]] = Counter()
        self._started = time.monotonic()
        bus.events.subscribe(self._event)

    def _event(self, event: wire.EventInfo) -> None:
        self._events[event.kind, LEVEL_LABELS.get(event.level, event.level)] += 1

    def text(self, sources: Sources) -> str:
        """The page for Prometheus. Call it in the event loop, the only thread that changes these values."""
        page = PrometheusText()
        page.family("imuscope_build_info", "gauge", "Always 1; version and platform of the server.")
        page.add(1, version=VERSION, python=platform.python_version(), machine=platform.machine(), run=sources.bus.run)
        page.family("imuscope_uptime_seconds", "gauge", "Time since this server was created.")
        page.add(time.monotonic() - self._started)
        _devices(page, sources.bus.devices.latest.values())
        _links(page, list(sources.sessions), sources.bus.now())
        _clients(page, sources.clients, sources.bus.now())
        _recording(page, sources)
        for add in sources.others:
            add(page)
        page.family("imuscope_events_total", "counter", "Entries of the event log, by kind and level.")
        for (kind, level), count in sorted(self._events.items()):
            page.add(count, kind=kind, level=level)
        _process(page)
        return str(page)


def _devices(page: PrometheusText, infos: Iterable[wire.DeviceInfo]) -> None:
    infos = list(infos)
    page.family("imuscope_device_info", "gauge", "Always 1; identity of a device, and its link.")
    for info in infos:
        labels = {name: getattr(info, name) for name in ("name", "source", "link", "protocol", "product")}
        page.add(1, device=info.id, **labels, serial_number=info.serial_number, firmware=info.firmware)
    page.family("imuscope_device_state", "gauge", "1 for the state that a device is in, 0 for the others.")
    for info in infos:
        for state in STATES:
            page.add(int(info.status == state), device=info.id, state=state)


def _links(page: PrometheusText, sessions: list[Session], now: float) -> None:
    every = [health for session in sessions for health in session.health_of_all(now)]
    first = [session.health(now) for session in sessions]

    page.family("imuscope_link_received_bytes_total", "counter", "Bytes received over a link.")
    for health in first:
        page.add(health.bytes, device=health.device)
    words = "Bytes dropped because decoding could not keep up; a recording has them."
    page.family("imuscope_link_left_out_bytes_total", "counter", words)
    for session in sessions:
        page.add(session.access.link.flow.dropped, device=session.info.id)
    page.family("imuscope_link_capacity_bytes_per_second", "gauge", "Capacity of a link, if known.")
    for health in first:
        page.add(health.capacity, device=health.device)
    page.family("imuscope_link_frames_total", "counter", "Decoded frames, by message.")
    for health in every:
        for message in health.messages:
            page.add(message.count, device=health.device, message=message.name)
    page.family("imuscope_link_rejects_total", "counter", "Frame candidates that were rejected, by reason.")
    for health in first:
        for reason, count in sorted(health.rejects_by.items()):
            page.add(count, device=health.device, reason=reason)
    words = "Bytes that belong to no accepted frame and no known message."
    page.family("imuscope_link_unclaimed_bytes_total", "counter", words)
    for health in first:
        page.add(health.unclaimed, device=health.device)
    page.family("imuscope_link_gaps_total", "counter", "Gaps in the counters of a device.")
    for health in every:
        page.add(health.gaps, device=health.device)
    page.family("imuscope_link_lost_samples_total", "counter", "Samples missing according to the counters of a device.")
    for health in every:
        page.add(health.lost, device=health.device)
    page.family("imuscope_link_unverified_samples_total", "counter", "Samples whose frames could not be checked.")
    for health in every:
        page.add(health.unverified, device=health.device)
    words = "From the arrival of the oldest waiting byte until its samples are queued for the browsers."
    page.family("imuscope_link_latency_seconds", "histogram", words)
    for session in sessions:
        page.histogram(session.latency, device=session.info.id)
    page.family("imuscope_link_last_arrival_timestamp_seconds", "gauge", "Time of the last received bytes, Unix time.")
    for health in every:
        page.add(health.last_arrival, device=health.device)
    page.family("imuscope_link_late_seconds", "gauge", "By how much later than its fastest bytes the newest arrived.")
    for health in every:
        page.add(health.behind.link, device=health.device)
    page.family("imuscope_decoding_behind_seconds", "gauge", "Age of the oldest bytes that are not decoded.")
    for health in every:
        page.add(health.behind.decoding, device=health.device)
    _clocks(page, every)


def _clocks(page: PrometheusText, every: Iterable[wire.DeviceHealth]) -> None:
    every = list(every)
    page.family("imuscope_clock_jitter_seconds", "gauge", "p99 of arrival minus expected arrival, last seconds.")
    for health in every:
        page.add(None if health.jitter_ms is None else health.jitter_ms / 1e3, device=health.device)
    page.family("imuscope_clock_drift_ratio", "gauge", "Device clock against the host clock; 1e-6 is 1 ppm.")
    for health in every:
        page.add(None if health.drift_ppm is None else health.drift_ppm / 1e6, device=health.device)
    page.family("imuscope_clock_drift_uncertainty_ratio", "gauge", "Uncertainty (±) of the drift.")
    for health in every:
        page.add(None if health.drift_bound_ppm is None else health.drift_bound_ppm / 1e6, device=health.device)
    page.family("imuscope_clock_uncertainty_seconds", "gauge", "Uncertainty (±) of device time mapped to host time.")
    for health in every:
        page.add(None if health.uncertainty_ms is None else health.uncertainty_ms / 1e3, device=health.device)


def _clients(page: PrometheusText, clients: ClientStatistics, now: float) -> None:
    queues = clients.queues
    page.family("imuscope_clients", "gauge", "Connected browsers.").add(clients.browsers)
    page.family("imuscope_clients_connected_total", "counter", "Browsers connected so far.").add(clients.connected)
    words = "Samples dropped for slow browsers, including disconnected ones."
    page.family("imuscope_dropped_samples_total", "counter", words)
    page.add(clients.dropped)
    page.family("imuscope_sent_bytes_total", "counter", "Bytes sent to browsers, including disconnected ones.")
    page.add(clients.sent_bytes)
    page.family("imuscope_client_lag_seconds", "gauge", "Age of the oldest data that a browser has not received.")
    for queue in queues:
        page.add(queue.lag(now), client=str(queue.number))
    page.family("imuscope_client_dropped_samples_total", "counter", "Samples dropped for this browser.")
    for queue in queues:
        page.add(queue.dropped, client=str(queue.number))
    page.family("imuscope_client_sent_bytes_total", "counter", "Bytes sent to this browser.")
    for queue in queues:
        page.add(queue.sent_bytes, client=str(queue.number))
    page.family("imuscope_client_waiting_bytes", "gauge", "Bytes of live samples queued for this browser.")
    for queue in queues:
        page.add(queue.live_bytes, client=str(queue.number))


def _recording(page: PrometheusText, sources: Sources) -> None:
    state = sources.recorder
    page.family("imuscope_recording_running", "gauge", "1 while a recording runs.").add(int(state.running))
    words = "1 if the last recording ended with an error, for example a full disk or a missing folder."
    page.family("imuscope_recording_failed", "gauge", words).add(int(bool(state.message) and not state.running))
    page.family("imuscope_recording_bytes", "gauge", "Size of the current recording, all parts.")
    page.add(state.bytes if state.running else None)
    page.family("imuscope_recording_lag_seconds", "gauge", "Age of the oldest byte not yet passed to the disk.")
    page.add(state.behind_s if state.running else None)
    page.family("imuscope_recording_seconds_left", "gauge", "Time until the disk is full, at the present rate.")
    page.add(state.seconds_left)
    page.family("imuscope_data_free_bytes", "gauge", "Free space for the data folder.").add(_free(sources.data))
    states = Counter(job.state for job in sources.exports)
    page.family("imuscope_exports", "gauge", "Exports, by state.")
    for name in ("waiting", "running", "done", "failed", "cancelled"):
        page.add(states[name], state=name)


def _free(data: Path) -> int | None:
    for folder in (data, *data.parents):  # the folder is created with the first file
        try:
            return shutil.disk_usage(folder).free
        except FileNotFoundError:
            continue
        except OSError:
            return None
    return None


def _process(page: PrometheusText) -> None:
    """Metrics under the standard names of Prometheus clients; those that the system does not provide are omitted."""
    used = os.times()
    page.family("process_cpu_seconds_total", "counter", "Processor time, user and system, all threads.")
    page.add(used.user + used.system)
    try:
        stat = (_PROC / "stat").read_text().rsplit(")", 1)[1].split()
        boot = next(line for line in Path("/proc/stat").read_text().splitlines() if line.startswith("btime"))
        open_files = len(os.listdir(_PROC / "fd"))
    except (OSError, StopIteration):
        return
    page.family("process_start_time_seconds", "gauge", "Start time of the process, Unix time.")
    page.add(int(boot.split()[1]) + int(stat[19]) / os.sysconf("SC_CLK_TCK"))
    page.family("process_virtual_memory_bytes", "gauge", "Address space.").add(int(stat[20]))
    page.family("process_resident_memory_bytes", "gauge", "Memory in RAM.")
    page.add(int(stat[21]) * os.sysconf("SC_PAGE_SIZE"))
    page.family("process_open_fds", "gauge", "Open files and sockets.").add(open_files)
