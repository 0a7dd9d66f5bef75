"""The HTML file: tables made here, plots drawn by the script inside (web/src/extensions/evidence/).

Nothing in it can reach a network: the content-security policy in its head allows the one script and the one style sheet
by their digests, and no connection, image, font, frame or form. What devices and people wrote is escaped text; in the
JSON of the samples no "<" is left, so that nothing can end its element.
"""

import base64
import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from typing import Any

from imuscope.server.extensions.evidence.series import Blocks

DASH = "—"
FIGURES = (
    *(("mean", "mean", ""), ("sigma", "σ", ""), ("rms", "rms", ""), ("min", "min", ""), ("max", "max", "")),
    *(("peak_to_peak", "peak to peak", ""), ("slope", "slope", "/s"), ("integral", "integral", "·s")),
    *(("n", "samples", None), ("gaps", "gaps", None)),
)
Content = Mapping[str, Any]


def document(content: Content, blocks: Blocks, script: str, style: str) -> Iterator[str]:
    """The file, in pieces.

    Args:
        script, style: of the viewer; neither may contain the end tag of its element.
    """
    policy = (
        f"default-src 'none'; script-src '{_digest(script)}'; style-src '{_digest(style)}'; "
        "base-uri 'none'; form-action 'none'"
    )
    title = f"Evidence: {content['title']}"
    yield (
        '<!doctype html>\n<html lang="en" data-theme="light">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="referrer" content="no-referrer">\n'
        f"<title>{escape(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n"
    )
    yield _head(content)
    yield '<main>\n<section class="plots" id="plots" aria-label="Plots"><noscript><p>The plots need JavaScript; '
    yield "everything else can be read without.</p></noscript></section>\n"
    for part in (_figures, _notes, _events, _devices, _losses, _shown, _versions):
        yield part(content)
    yield "</main>\n"
    yield f'<script type="application/json" id="content">{_inert(content)}</script>\n'
    for number, text in enumerate(blocks.texts):
        yield f'<script type="text/plain" id="block-{number}">{text}</script>\n'
    yield f"<script>{script}</script>\n</body>\n</html>\n"


def _digest(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _inert(content: Content) -> str:
    """JSON in which nothing ends or opens an element."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


# ── parts ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def _head(content: Content) -> str:
    t0, t1 = content["t0"], content["t1"]
    recorded = content["recorded"]
    whole = recorded[1] - recorded[0] if None not in recorded else t1 - t0
    devices = ", ".join(
        " ".join(filter(None, (one["product"] or one["name"], one["serial_number"]))) for one in content["devices"]
    )
    base = "the device's clock" if content["base"] == "device" else "the time of arrival"
    lines = [
        f"{_moment(t0)} to {_moment(t1, date=_day(t0) != _day(t1))} UTC, {_length(t1 - t0)} of {_length(whole)}, "
        f"by {base}",
        devices,
    ]
    if content["tags"]:
        lines.append(f"Tags: {', '.join(content['tags'])}")
    if content["position"] is not None:
        lines.append(_position(content["position"]))
    rows = "".join(f"<p>{escape(line)}</p>" for line in lines if line)
    return f'<header><p class="kind">imuscope evidence</p><h1>{escape(content["title"])}</h1>{rows}</header>\n'


def _position(left_out: Mapping[str, int]) -> str:
    signals, settings, numbers = left_out["signals"], left_out["settings"], left_out["numbers"]
    return (
        f"Position left out: {_count(signals, 'signal')}, {_count(settings, 'setting')} and "
        f"{_count(numbers, 'number')} in texts."
    )


def _figures(content: Content) -> str:
    cursors = content["cursors"]
    parts = []
    if cursors["a"] is not None and cursors["b"] is not None:
        a, b = sorted((cursors["a"], cursors["b"]))
        words = f"Between the cursors, {_moment(a, date=False)} to {_moment(b, date=False)} UTC, {_length(b - a)}"
        parts.append(_figure_table(content, "between", words))
    parts.append(_figure_table(content, "figures", f"Whole range, {_length(content['t1'] - content['t0'])}"))
    return _section("Figures", "".join(parts), "Computed from every sample of the recording in the range.")


def _figure_table(content: Content, key: str, caption: str) -> str:
    heads = ["signal", *(name for _, name, _ in FIGURES)]
    rows = []
    for plot in content["plots"]:
        for series in plot["series"]:
            figures = series[key]
            cells = []
            for name, _, suffix in FIGURES:
                value = figures.get(name)
                unit = "" if suffix is None or value is None else f"{plot['unit']}{suffix}"
                cells.append(f"{_number(value)} {unit}".strip())
            rows.append([f"{plot['title']}: {series['label']}", *cells])
    return _table(heads, rows, caption, numbers=True)


def _notes(content: Content) -> str:
    notes = content["notes"]
    pieces = pieces_of(notes["text"], content["recorded"][0] or content["t0"])
    words = "".join(escape(piece) if t0 is None else _button(t0, piece, t1) for piece, t0, t1 in pieces)
    text = f'<p class="text">{words}</p>' if words else ""
    rows = [f"<li>{_at(one['time'])} <b>{escape(one['kind'])}</b> {escape(one['text'])}</li>" for one in notes["times"]]
    listed = f'<ul class="times">{"".join(rows)}</ul>' if rows else ""
    return _section("Notes", text + listed or "<p>None.</p>")


def _events(content: Content) -> str:
    rows = [
        f'<li class="{escape(one["level"] or "info")}">{_at(one["time"])} <b>{escape(one["kind"])}</b> '
        f"{escape(_of_device(content, one['device']))}{escape(one['text'] or '')}</li>"
        for one in content["events"]
    ]
    more = content["events_left_out"]
    words = f"<p>{_count(more, 'event')} more of the recording not listed.</p>" if more else ""
    listed = f'<ul class="times">{"".join(rows)}</ul>' if rows else "<p>None in this range.</p>"
    return _section("Events and alarms", listed + words)


def _of_device(content: Content, device: str | None) -> str:
    names = {one["id"]: one["name"] for one in content["devices"]}
    return f"{names.get(device, device)}: " if device and len(names) > 1 else ""


def _devices(content: Content) -> str:
    parts = []
    for one in content["devices"]:
        rows = [
            (title, one[name])
            for title, name in (
                ("Product", "product"),
                ("Serial number", "serial_number"),
                ("Firmware", "firmware"),
                ("Protocol", "protocol"),
                ("Source", "source"),
            )
            if one[name]
        ]
        facts = "".join(f"<dt>{title}</dt><dd>{escape(str(value))}</dd>" for title, value in rows)
        parts.append(f"<h3>{escape(one['name'])}</h3><dl>{facts}</dl>{_settings(one['settings'])}")
    return _section("Devices and settings", "".join(parts) or "<p>None.</p>")


def _settings(settings: Sequence[Mapping[str, Any]]) -> str:
    if not settings:
        return "<p>Settings were not recorded.</p>"
    rows = [
        [setting["title"] if number == 0 else "", title, words]
        for setting in settings
        for number, (title, words) in enumerate(setting["rows"])
    ]
    table = _table(["setting", "", "value"], rows)
    return f"<details><summary>{_count(len(settings), 'setting')}</summary>{table}</details>"


def _losses(content: Content) -> str:
    heads = ["device", "bytes", "messages", "samples lost", "gaps", "frames rejected"]
    names = ("bytes", "messages", "lost", "gaps", "rejects")
    rows = [[one["name"], *(_whole(one[name]) for name in names)] for one in content["devices"]]
    for row, one in zip(rows, content["devices"], strict=True):
        row[3] += " known" if one["restarts"] else ""
    hint = "Of the whole recording."
    if any(one["restarts"] for one in content["devices"]):
        hint += " Where a counter restarted, the number of lost samples is not known."
    for one in content["devices"]:
        hint += f" Rejected frames of {one['name']}: {'; '.join(one['rejects_by'])}." if one["rejects_by"] else ""
    damage = "".join(f"<p>{escape(words)}</p>" for words in content["damage"])
    in_range = [one for one in content["events"] if one["kind"] == "gap"]
    lost = sum(one["samples"] or 0 for one in in_range)
    words = f"<p>In this range: {_count(len(in_range), 'gap')} reported, {_count(lost, 'sample')} lost.</p>"
    return _section("Losses", _table(heads, rows, numbers=True) + words + damage, hint)


def _shown(content: Content) -> str:
    """Part of the samples that the file has."""
    curves = [(plot, series) for plot in content["plots"] for series in plot["series"]]
    thinned = [(plot, series) for plot, series in curves if "interval" in series]
    lines = []
    if not thinned:
        lines.append("Every sample of the range is in this file.")
    for plot, series in thinned:
        lines.append(
            f"{plot['title']}, {series['label']}: {_whole(2 * series['shown'])} of {_whole(series['n'])} samples; of "
            f"each {_length(series['interval'])} the least and the greatest, so that extremes are kept."
        )
    if thinned:
        lines.append("The figures above are of every sample. For more detail make evidence of a shorter range.")
    lines += [f"Not shown: {why}" for why in content["not_shown"]]
    lines += sorted({note for _, series in curves for note in series["notes"]})
    return _section("Samples in this file", "".join(f"<p>{escape(line)}</p>" for line in lines))


def _versions(content: Content) -> str:
    versions = content["versions"]
    rows = [
        ("imuscope", versions["imuscope"]),
        ("Decoders", versions["decoders"]),
        ("Columns", f"version {versions['columns']}"),
        ("Recording", " ".join(filter(None, (versions["recording"], content["file"])))),
        ("Evidence", f"version {content['format']}"),
        ("Made", f"{_moment(content['made'], decimals=0)} UTC"),
    ]
    facts = "".join(f"<dt>{title}</dt><dd>{escape(str(value))}</dd>" for title, value in rows)
    return _section("Versions", f"<dl>{facts}</dl>")


# ── pieces ───────────────────────────────────────────────────────────────────────────────────────────────────────────


def _section(title: str, body: str, hint: str = "") -> str:
    words = f'<p class="hint">{escape(hint)}</p>' if hint else ""
    return f"<section><h2>{escape(title)}</h2>{words}{body}</section>\n"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", *, numbers: bool = False) -> str:
    head = "".join(f'<th scope="col">{escape(one)}</th>' for one in heads)
    body = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in row[1:])}</tr>'
        for row in rows
    )
    words = f"<caption>{escape(caption)}</caption>" if caption else ""
    kind = ' class="numbers"' if numbers else ""
    label = escape(caption or heads[0])
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="{label}"><table{kind}>{words}'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _at(time: float) -> str:
    """A time that leads to its place in the plots."""
    return _button(time, _moment(time, date=False))


def _button(time: float, words: str, end: float | None = None) -> str:
    until = "" if end is None else f' data-end="{end!r}"'
    return f'<button type="button" class="time" data-time="{time!r}"{until}>{escape(words)}</button>'


def _number(value: Any) -> str:
    if value is None or not math.isfinite(value):
        return DASH
    if isinstance(value, int):
        return _whole(value)
    return f"{value:.6g}".replace("e-0", "e-").replace("e+0", "e").replace("-", "\u2212")


def _whole(value: Any) -> str:
    return DASH if value is None else f"{value:,}".replace(",", "\u2009")


def _count(n: int, noun: str) -> str:
    return f"{_whole(n)} {noun}{'s' * (n != 1)}"


def _day(time: float) -> str:
    return datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%d")


def _moment(time: float, *, date: bool = True, decimals: int = 3) -> str:
    moment = datetime.fromtimestamp(round(time, 6), UTC)
    clock = moment.strftime("%H:%M:%S.%f")[: 9 + decimals if decimals else 8]
    return f"{_day(time)} {clock}" if date else clock


def _length(seconds: float) -> str:
    if seconds < 1:
        return f"{seconds * 1000:.3g} ms"
    if seconds < 120:
        return f"{seconds:.3f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02} min {rest:02} s" if hours else f"{minutes} min {rest:02} s"


_CLOCK = r"(?:(\d{4}-\d\d-\d\d) )?(\d\d):(\d\d):(\d\d(?:\.\d{1,7})?)"
_TIMES = re.compile(rf"\[{_CLOCK}(?:\s*[–-]\s*{_CLOCK})?\]")
DAY_S = 86_400


def pieces_of(text: str, first: float) -> list[tuple[str, float | None, float | None]]:
    """Pieces of a text, each with its moment, or with both ends of its range; None: plain text.

    Times lead to a moment or a range: `[14:32:18.500]`, `[14:32:18 – 14:32:20]`, `[2026-11-21 14:32:18]`. As on the
    page (web/src/extensions/notes/panel.tsx): UTC; without a day the first such time from the beginning of the
    recording on.

    Args:
        first: beginning of the recording, unix s.
    """
    pieces: list[tuple[str, float | None, float | None]] = []
    at = 0
    for match in _TIMES.finditer(text):
        words = match.groups()
        t0 = _time_of(words[:4], math.floor(first))
        t1 = None if t0 is None or words[5] is None else _time_of(words[4:], t0)
        if t0 is None:
            continue
        pieces += [(text[at : match.start()], None, None), (match[0][1:-1], t0, t1)]
        at = match.end()
    return [piece for piece in [*pieces, (text[at:], None, None)] if piece[0]]


def _time_of(words: tuple[str | None, ...], begin: float) -> float | None:
    """The moment of a clock; None: there is no such day."""
    day, hours, minutes, seconds = words
    time = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0)
    if day is not None:
        try:
            return datetime.strptime(day, "%Y-%m-%d").replace(tzinfo=UTC).timestamp() + time
        except ValueError:
            return None
    moment = begin // DAY_S * DAY_S + time
    return moment + DAY_S if moment < begin else moment
