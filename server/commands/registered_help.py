"""Help on registered links and export formats. It imports them, so it is generated only when help is printed."""

import textwrap

from imuscope.server.devices.decode.decode_options import url_options
from imuscope.server.links.registry import LinkDefinition, link_kinds
from imuscope.server.services.extension import file_outputs

_NAME_CHARS = 34


def source_list() -> str:
    """The forms of sources, in one line."""
    forms = ", ".join(one.short_form or one.form for one in link_kinds())
    return f"{forms}; `imuscope serve --help` has their options"


def source_help() -> str:
    """Sources with their options, a line or more for each."""
    lines = [line for one in link_kinds() for line in _usage(one)]
    return "\n".join(["sources, with their options after a question mark:", *lines, *_of_any(), ""])


def _of_any() -> list[str]:
    names = ", ".join(f"{name}=" for name in url_options())
    wrapped = textwrap.wrap(f"{names}: like the options above", 120 - _NAME_CHARS)
    return [f"{'  any of them' if line == wrapped[0] else '':<{_NAME_CHARS}}{line}" for line in wrapped]


def _usage(kind: LinkDefinition) -> list[str]:
    lines = []
    for form, words in kind.usage or ((kind.form, kind.title),):
        first, *more = words.split("\n")
        is_short = len(form) < _NAME_CHARS - 3
        lines += [f"  {form:<{_NAME_CHARS - 2}}{first}"] if is_short else [f"  {form}", f"{'':{_NAME_CHARS}}{first}"]
        lines += [f"{'':{_NAME_CHARS}}{line}" for line in more]
    return lines


def output_list() -> str:
    """Suffixes of the export formats, in one line."""
    from imuscope.recordings.exporters import FORMATS

    titles: dict[str, str] = {}
    for one in FORMATS.values():
        titles.setdefault(one.suffix, one.title)
    titles |= {one.suffix: one.title for one in file_outputs().values()}
    formats = ", ".join(f"{suffix} ({title})" for suffix, title in titles.items())
    return f"file whose suffix selects the format: {formats}; CSV and Parquet: a file per message, OUT_MESSAGE.csv"
