"""Files as sources: a recording is replayed, a pipe is read as a stream, anything else is played as a capture."""

from imuscope.server.links.base import Link, LinkSettings
from imuscope.server.links.capture_file import SPEED_RANGE, FileLink
from imuscope.server.links.pipe import PipeLink, is_pipe
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.replay import OPTIONS, ReplayLink, is_recording
from imuscope.server.links.source_url import SourceUrl


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    if is_recording(parsed.place) or {"device", "from", "to"} & parsed.options.keys():
        parsed.allow(OPTIONS)
        return ReplayLink(source, settings, parsed)
    if is_pipe(parsed.place):
        parsed.allow(())
        return PipeLink(source, settings, parsed.place)
    parsed.allow(("speed", "loop"))
    return FileLink(source, settings, parsed.place, parsed.number("speed", 1, *SPEED_RANGE), parsed.switch("loop"))


register_link(
    LinkDefinition(
        "file",
        "File",
        _open,
        "capture.bin",
        short_form="a file, a pipe, - (standard input)",
        usage=(
            ("FILE?speed=4&loop=1", "a capture with its original timing; for a recording also device=, from=, to="),
            ("-, a pipe", "live data without delay; a capture with its original timing"),
        ),
        order=40,
    )
)
