"""Answers for programs that watch over a server, without routes: a health check, devices, metrics for Prometheus."""

from typing import Any

from imuscope.server.diagnostics.metrics import Sources
from imuscope.server.services.services import Services
from imuscope.server.wire.codec import to_json_safe


def health(services: Services) -> dict[str, Any]:
    """The answer to a health check: no device data but the number of devices."""
    telemetry = services.telemetry
    return {"status": "ok", "devices": len(telemetry.bus.devices.latest), "browsers": telemetry.clients.browsers}


def device_list(services: Services) -> list[dict[str, Any]]:
    """The answer of GET /api/devices, which needs no routes: a watcher that waits for them takes a server for dead."""
    return [to_json_safe(info) for info in services.sessions.infos]


def metrics_page(services: Services) -> str:
    """Metrics in the text format of Prometheus (server/diagnostics/metrics.py)."""
    sources = Sources(
        services.telemetry.bus,
        services.telemetry.clients.statistics,
        services.sessions.all,
        services.recorder.state,
        services.exports.jobs,
        services.config.data,
        services.parts.metrics,
    )
    return services.metrics.text(sources)
