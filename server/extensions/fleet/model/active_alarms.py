"""Active alarms of this robot, as reported to its fleet."""

from __future__ import annotations

from imuscope.server.extensions.alarms.service import AlarmService
from imuscope.server.extensions.fleet.model.device_figures import clipped
from imuscope.server.extensions.fleet.model.reports import AlarmRaisedState, ReportedAlarm


def active_alarms(alarms: AlarmService) -> list[ReportedAlarm]:
    """The alarms that are raised at present, one for each device."""
    reports = []
    for stored in alarms.alarms:
        for state in alarms.states(stored.id):
            if state.raised:
                acknowledged: AlarmRaisedState = "raised" if state.acknowledged is None else "acknowledged"
                shown: AlarmRaisedState = "missing" if state.status == "missing" else acknowledged
                definition = stored.definition
                reports.append(ReportedAlarm(clipped(definition.name), definition.level, shown, clipped(state.device)))
    return reports
