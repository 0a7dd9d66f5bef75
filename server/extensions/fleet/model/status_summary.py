"""The status of a robot, as it reports it, as the summary that the page shows."""

import msgspec

from imuscope.server.extensions.fleet.model.reports import RobotStatus
from imuscope.server.extensions.fleet.model.summaries import RobotAlarm, RobotSummary


def summary_of(name: str, status: RobotStatus, since: float, *, is_live: bool = True) -> RobotSummary:
    """A status as the page shows it."""
    return RobotSummary(
        name=name,
        group=status.group,
        state="live" if is_live else "lost",
        since=since,
        latency_ms=status.latency_ms,
        version=status.version,
        address=status.address,
        pages=status.pages,
        recording=status.recording,
        disk_free_bytes=status.disk_free_bytes,
        settings="unknown",
        drifted=0,
        same_name=0,
        alarms=[RobotAlarm.model_validate(msgspec.structs.asdict(one)) for one in status.alarms],
        devices=list(status.devices),
        more=status.more,
    )
