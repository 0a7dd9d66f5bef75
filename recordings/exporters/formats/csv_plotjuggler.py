"""CSV that PlotJuggler opens at once: one table of all quantities, with a line for each moment.

    __time,arrival,/MTi-630/Acceleration/x_m_s2,…      names as in MCAP, so a layout made with one fits the other

A cell without a sample is empty, as is one that is not a finite number. A name has no blank: PlotJuggler would take
blanks for the separator. The segment of the clock is a column if there are several, of one device. Tables (satellites)
and undescribed bytes are left out.
"""

from pathlib import Path

from imuscope.recordings.exporters.registry import ExportFormat, register_exporter
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the file; returns it."""
    import pyarrow as pa
    import pyarrow.compute as pc

    from imuscope.recordings.exporters.csv_tables import heading, lines
    from imuscope.recordings.exporters.message_table import SEGMENT, MessageTable, batches
    from imuscope.recordings.exporters.topics import fields_of

    topics = channel_topics(request)
    infos = [info for info in (*request.clocks, *request.infos) if info["kind"] != "table"]
    if not infos:
        raise ExportError("This range contains no channel with one value at a time.", "Choose other channels.")
    names = [[f"{topics[info['id']]}/{field}" for field in fields_of(info)] for info in infos]
    devices = {info["device"] for info in infos}
    segments = request.segments(devices.pop()) if len(devices) == 1 else ()
    table = MessageTable("", "", infos, names, segments=segments)
    with out.open("wb") as file:
        own = [name for some in names for name in some]
        heading(file, ["__time", "arrival", *([SEGMENT] if segments else ()), *own])
        for batch in batches(request, table, step):
            time, *cells = batch.columns
            cells = [
                pc.if_else(pc.is_finite(one), one, None) if pa.types.is_floating(one.type) else one for one in cells
            ]
            filled = [pc.coalesce(time, batch.columns[1]), *cells]
            lines(file, pa.RecordBatch.from_arrays(filled, names=batch.schema.names))
    return [out]


def channel_topics(request: ExportRequest) -> dict[int, str]:
    """Names of all channels and clocks of the recording, so that the choice changes no name."""
    from imuscope.recordings.exporters.topics import named, topic_of

    topics: dict[int, str] = {}
    for info in request.columns.manifest["channels"]:
        topics[info["id"]] = topic_of(request.device_name(info["device"]), info, topics.values())
    for info in request.clocks:
        what = "utc" if [column["name"] for column in info["columns"]] == ["utc"] else "clock"
        device = request.device_name(info["device"])
        topics[info["id"]] = named(device, info["message"], what, in_use=topics.values())
    return topics


register_exporter(
    ExportFormat(
        "csv-plotjuggler",
        "CSV for PlotJuggler",
        ".plotjuggler.csv",
        write,
        order=12,
        label="CSV, PlotJuggler",
        words="one table, names as in a tree",
        takes_units=True,
        per_byte=3.0,
    )
)
