"""Document blocks, written as Markdown or as HTML.

`parse` reads the small part of Markdown that docstrings are written in:

    ## Title          Heading
    text text         Paragraph; lines of one paragraph are joined
    - text            Items
        anything      Code, indented by four spaces

Within a text, `code` between backquotes is left unchanged, and [text](#heading) or [text](/docs/page) is a link. The
rest is plain text and is escaped for either format.
"""

import html
import re
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

_CODE = re.compile(r"(`[^`]+`)")
_LINK = re.compile(r"\[([^\]]+)\]\((#[\w-]+|/[\w./-]*)\)")
_PLAIN = re.compile(r"[\\<>*|]")


@dataclass(frozen=True, slots=True)
class Heading:
    """A title; level 1 is the document's own."""

    level: int
    text: str


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Running text."""

    text: str


@dataclass(frozen=True, slots=True)
class Items:
    """An unordered list."""

    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Code:
    """Preformatted text."""

    text: str
    language: str = ""


@dataclass(frozen=True, slots=True)
class TableBlock:
    """A table with a header; every row has as many cells as the header."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


Block = Heading | Paragraph | Items | Code | TableBlock


def anchor(text: str) -> str:
    """The link fragment of a heading, by GitHub's rule."""
    return re.sub(r"[^\w\- ]", "", text.lower()).strip().replace(" ", "-")


def parse(text: str, level: int = 0) -> Iterator[Block]:
    """The blocks of a docstring.

    Args:
        text: without common indentation (inspect.cleandoc).
        level: added to the level of its headings.
    """
    for part in _parts(text):
        lines = part.splitlines()
        if part.startswith("    "):
            yield Code(textwrap.dedent(part))
        elif part.startswith("#"):
            marks, _, title = lines[0].partition(" ")
            yield Heading(len(marks) + level, title.strip())
            if rest := "\n".join(lines[1:]):
                yield from parse(rest, level)
        elif part.startswith("- "):
            yield Items(tuple(" ".join(item.split()) for item in re.split(r"^- ", part, flags=re.MULTILINE)[1:]))
        else:
            yield Paragraph(" ".join(line.strip() for line in lines))


def _parts(text: str) -> Iterator[str]:
    """Text between empty lines; consecutive indented parts are joined."""
    code: list[str] = []
    for part in re.split(r"\n[ \t]*\n", text.strip("\n")):
        if code and not part.startswith("    "):
            yield "\n\n".join(code)
            code.clear()
        if part.startswith("    "):
            code.append(part)
        elif part.strip():
            yield part
    if code:
        yield "\n\n".join(code)


def to_markdown(blocks: Iterable[Block]) -> str:
    """A document in GitHub's Markdown; links below /docs become links to files in the same folder."""
    text = "\n\n".join(_markdown(block) for block in blocks) + "\n"
    return re.sub(r"\]\(/docs/([\w-]+)\)", r"](\1.md)", text)


def _markdown(block: Block) -> str:
    match block:
        case Heading(level, text):
            return f"{'#' * level} {_escaped(text)}"
        case Paragraph(text):
            return _escaped(text)
        case Items(texts):
            return "\n".join(f"- {_escaped(text)}" for text in texts)
        case Code(text, language):
            return f"```{language}\n{text.rstrip()}\n```"
        case TableBlock(head, rows):
            lines = [head, ("---",) * len(head), *rows]
            return "\n".join(f"| {' | '.join(map(_cell, line))} |" for line in lines)


def _escaped(text: str) -> str:
    return "".join(
        part if part.startswith("`") else _PLAIN.sub(lambda match: f"\\{match[0]}", part) for part in _CODE.split(text)
    )


def _cell(text: str) -> str:
    """A table cell, with bars escaped, also in code."""
    return "".join(part.replace("|", "\\|") if part.startswith("`") else _escaped(part) for part in _CODE.split(text))


def to_html(blocks: Iterable[Block]) -> str:
    """The document's blocks as HTML, without a surrounding page."""
    return "\n".join(_html(block) for block in blocks)


def _html(block: Block) -> str:
    match block:
        case Heading(level, text):
            return f'<h{level} id="{html.escape(anchor(text))}">{_inline(text)}</h{level}>'
        case Paragraph(text):
            return f"<p>{_inline(text)}</p>"
        case Items(texts):
            return f"<ul>{''.join(f'<li>{_inline(text)}</li>' for text in texts)}</ul>"
        case Code(text):
            return f'<pre tabindex="0"><code>{html.escape(text.rstrip())}</code></pre>'
        case TableBlock(head, rows):
            top = "".join(f'<th scope="col">{_inline(cell)}</th>' for cell in head)
            body = "".join(f"<tr>{''.join(f'<td>{_inline(cell)}</td>' for cell in row)}</tr>" for row in rows)
            table = f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
            return f'<div class="scroll" tabindex="0">{table}</div>'


def _inline(text: str) -> str:
    parts = (
        f"<code>{html.escape(part[1:-1])}</code>"
        if part.startswith("`")
        else _LINK.sub(r'<a href="\2">\1</a>', html.escape(part, quote=False))
        for part in _CODE.split(text)
    )
    return "".join(parts)
