"""Alarms: conditions on live devices, evaluated by the server on every sample, with or without a page that looks.

    definitions.py   what a user sets: condition, limits, durations, for which devices
    conditions.py    a condition compiled for one device: its samples ─> time, code, value
    figures.py       conditions on figures of a link: rate, loss, silence, clock, connection
    machine.py       codes ─> ok, pending, raised, cleared, missing; pure
    recording_trigger.py   raised alarms ─> recordings that begin before the limit was crossed
    webhooks.py      changes of alarms ─> POST to an address, in the background
    stored.py        without a stored alarm, the service is made for the first request
    service.py       samples of the bus ─> machines ─> events; acknowledgement
    alarm_file.py    definitions and states in the data folder

A code says for each sample whether the condition holds (BEYOND), it is within its limit to clear (WITHIN), between both
(BETWEEN), or is not known (UNKNOWN). Durations run in the time of the samples, so that the result does not depend on
how they were divided into batches.
"""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "alarms",
    "Alarms",
    parts="imuscope.server.extensions.alarms.stored",
    page_parts="imuscope.server.extensions.alarms.service",
    routes=("imuscope.server.extensions.alarms.routes",),
    read_only_posts=("/api/alarms/check", "/api/alarms/preview"),
    jobs=("imuscope.server.extensions.alarms.preview",),
    requires=("analysis",),
)
