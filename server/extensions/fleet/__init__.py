"""Many robots: their recordings in one store with questions about them, and their present state on one page.

The store needs `imuscope[fleet]`.

    store.py       where it is: a folder, S3, Azure or Google Cloud Storage; its errors in words
    tables.py      the tables and their columns
    upload.py      a recording into the store: its file, then its rows
    uploads.py     finished recordings of this robot into the store; upload_worker.py, upload_log.py
    recording_digest.py    what makes two files the same recording
    metadata.py, samples.py, minute_statistics.py    rows of an opened recording; packet_rows.py: rows of one packet
    delta_tables.py    appending exactly once
    query.py       SQL over the tables, read-only and limited
    query_service.py, query_worker.py    questions over HTTP: in turns (fair_queue.py), each in a process of its own
    prepared_queries.py    prepared questions
    fetch.py         a recording out of the store
    compact.py       small files joined
    results.py     answers as a table, CSV, JSON or Arrow

    keys.py, reports.py    the bus: its keys, and the messages published under them
    bus.py, access.py      sessions of Zenoh, and the access rules of the router
    publisher.py           a robot's side (`--fleet`); device_figures.py is in its reports
    device_settings.py     settings of a device and their digest; known_settings.py has those of this robot
    operators.py           users who may command robots of some groups
    group_profiles.py      how far robots are from the profiles of their groups
    fleet_alarms.py        alarms that a fleet server raises itself
    rollouts.py            a profile, applied to its group in waves: rollout_plan.py, rollout_steps.py for one device
    journal.py             its last events, for when the line was away; journal_files.py has them over restarts
    fleet_server.py        the other side (`imuscope fleet`): receives, requests, stores
    collector.py           what it makes of tokens and reports
    database.py            what it keeps over restarts
    robots.py              the robots that a fleet server knows, and what changed of them
    summaries.py           a robot at a glance

docs/fleet.md describes the layout of a store for other programs.
"""

from imuscope.server.services.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "fleet",
    "Fleet",
    modules=("zenoh", "msgspec"),
    extra="fleet",
    parts="imuscope.server.extensions.fleet.server.parts",
    page_parts="imuscope.server.extensions.fleet.query.query_service",
    routes=(
        "imuscope.server.extensions.fleet.query.question_routes",
        "imuscope.server.extensions.fleet.upload.upload_routes",
        "imuscope.server.extensions.fleet.server.robot_routes",
        "imuscope.server.extensions.fleet.server.profile_routes",
        "imuscope.server.extensions.fleet.server.rollout_routes",
        "imuscope.server.extensions.fleet.server.page_routes",
    ),
    read_only_posts=("/api/query",),
    commands=(
        ExtensionCommand(
            "upload",
            "imuscope.server.extensions.fleet.server.fleet_arguments:add_upload",
            "imuscope.server.extensions.fleet.server.store_commands:upload",
            scope="source",
            protocol_help="protocol of a capture (default: detected)",
            reads_file=True,
        ),
        ExtensionCommand(
            "query",
            "imuscope.server.extensions.fleet.server.fleet_arguments:add_query",
            "imuscope.server.extensions.fleet.server.store_commands:query",
            has_data=False,
        ),
        ExtensionCommand(
            "compact",
            "imuscope.server.extensions.fleet.server.fleet_arguments:add_compact",
            "imuscope.server.extensions.fleet.server.store_commands:compact",
            reads_file=True,
            has_data=False,
        ),
        ExtensionCommand(
            "fleet",
            "imuscope.server.extensions.fleet.server.fleet_arguments:add_fleet",
            "imuscope.server.extensions.fleet.server.fleet_command:serve_fleet",
        ),
    ),
    requires=("alarms",),
    checks="imuscope.server.extensions.fleet.store.store:check_store",
    diagnoses="imuscope.server.extensions.fleet.robot.diagnosis:findings",
)
