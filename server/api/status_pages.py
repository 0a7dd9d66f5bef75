"""Pages for programs that watch over a server: a health check, and metrics for Prometheus."""

from __future__ import annotations

from typing import Any

from imuscope.server.metrics import Sources
from imuscope.server.services import Services


def health(services: Services) -> dict[str, Any]:
    """The answer to a health check: no device data but the number of devices."""
    telemetry = services.telemetry
    return {"status": "ok", "devices": len(telemetry.bus.devices.latest), "browsers": telemetry.clients.browsers}


def metrics_page(services: Services) -> str:
    """Metrics in the text format of Prometheus (server/metrics.py)."""
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
