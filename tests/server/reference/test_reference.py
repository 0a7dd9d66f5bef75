"""Reference pages: correct, complete and harmless in a browser."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser
from typing import Any

import pytest

from imuscope.server.generators import files as generated_files
from imuscope.server.reference.blocks import Code, Heading, Items, Paragraph, TableBlock, parse, to_html, to_markdown
from imuscope.server.reference.pages import PAGES, ReferencePages
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.source_files import ROOT

GENERATED = r"^(<!-- |/\*\* ).*Generated (from|by) .*do not edit"


@pytest.fixture(scope="module")
def openapi() -> Mapping[str, Any]:
    return generated_files.document()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    with InProcessServer(Config(data=tmp_path_factory.mktemp("data"), sources=("/dev/one",)), FakeLink) as running:
        yield running


class Elements(HTMLParser):
    """Ids, links and names of the elements of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: Counter[str] = Counter()
        self.links: set[str] = set()
        self.tags: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags.add(tag)
        if name := values.get("id"):
            self.ids[name] += 1
        if tag == "a" and (link := values.get("href")):
            self.links.add(link)


def test_generated_files_are_marked() -> None:
    """A reviewer does not read them, and what counts lines does not count them."""
    results = subprocess.check_output(
        ["git", "grep", "-lE", GENERATED, "--", "*.md", "*.ts"], cwd=ROOT, text=True
    ).split()
    assert len(results) > 1
    marked = {line.split()[0] for line in (ROOT / ".gitattributes").read_text().splitlines() if "generated" in line}
    assert not [name for name in results if name not in marked]


@each_row("name", PAGES)
def test_every_heading_is_addressed_once_and_every_link_leads_somewhere(name: str, openapi: Mapping[str, Any]) -> None:
    page = Elements(ReferencePages().html(name, lambda: openapi))
    assert [anchor for anchor, count in page.ids.items() if count > 1] == []
    assert {link.removeprefix("#") for link in page.links if link.startswith("#")} <= set(page.ids)
    assert {link.removeprefix("/docs/") for link in page.links if link.startswith("/")} <= set(PAGES)


def test_every_request_is_described(openapi: Mapping[str, Any]) -> None:
    text = to_markdown(PAGES["http-api"].blocks(openapi))
    for path, operations in openapi["paths"].items():
        for method in operations:
            assert f"\n### {method.upper()} {path}\n" in text


@each_row("address", ["/docs", *(f"/docs/{name}" for name in PAGES)])
def test_pages_are_served_and_run_no_script_of_their_own(address: str, running: InProcessServer) -> None:
    answer = running.client.get(address)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert "script-src 'self'" in answer.headers["content-security-policy"]
    assert "<h1" in answer.text
    assert "<!-- content -->" not in answer.text
    assert not re.search(r"https?://|<script(?! src=\"\.{1,2}/)|<style|\son\w+=|\sstyle=", answer.text)
    again = running.client.get(address, headers={"if-none-match": answer.headers["etag"]})
    assert again.status_code == 304


def test_a_missing_page_is_not_found(running: InProcessServer) -> None:
    answer = running.client.get("/docs/nothing")
    assert answer.status_code == 404
    assert answer.json()["kind"] == "not-found"


def test_docstrings_become_blocks() -> None:
    text = "First line\nof two.\n\n## Title\n\n    a  b\n\n    c\n\n- one\n- two,\n  longer\n"
    assert list(parse(text, level=1)) == [
        Paragraph("First line of two."),
        Heading(3, "Title"),
        Code("a  b\n\nc"),
        Items(("one", "two, longer")),
    ]


def test_text_is_escaped_for_its_format() -> None:
    blocks = [Paragraph("<b> & `<i>`"), TableBlock(("a",), (("x | `y|z`",),)), Paragraph("[HTTP](/docs/http-api)")]
    assert to_html(blocks[:1]) == "<p>&lt;b&gt; &amp; <code>&lt;i&gt;</code></p>"
    assert to_markdown(blocks) == "\\<b\\> & `<i>`\n\n| a |\n| --- |\n| x \\| `y\\|z` |\n\n[HTTP](http-api.md)\n"
