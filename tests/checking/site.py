"""The documentation site, of docs/ and the files beside it: `python -m tests.checking.site` writes artifacts/site.

Built by MkDocs with mkdocs.yml, strictly: a link or an anchor that leads nowhere is an error. It is built anew when
something that it is made from has changed. Below are the hooks that mkdocs.yml names.

The sources are written for GitHub, so links go from file to file. Those to documents at the top of the project, which
become pages, are adapted; those to other files of the project become links to the repository (`SITE_SOURCES`, its
address up to the path) or, without one, the names of the files.
"""

import logging
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import griffe

import imuscope.plugin
from imuscope.plugin import public_names

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "artifacts" / "site"
PACKAGE = ROOT / "artifacts" / "site-modules"  # what is shown of ours: the other 800 files would take 3 s to read
STAMP = SITE / ".sources"
DOCS = "docs"
TOP = ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "CODE_OF_CONDUCT.md")
SOURCES = os.environ.get("SITE_SOURCES", "").rstrip("/")
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?!https?:|mailto:|#)([^)#\s]+)(#[^)\s]*)?\)")
ENTRY = re.compile(r"\[([^\]]+)\]\(([^)#:\s]+)\)")
ELSEWHERE = re.compile(rb'<(?:script|img|iframe|link)\b[^>]*\b(?:src|href)="(?:https?:)?//[^"]*"')
DOCTEST = re.compile(r"(?:^>>> .*\n(?:(?!\n).+(?:\n|$))*)+", re.MULTILINE)
log = logging.getLogger("mkdocs.hooks.site")


class Fenced(griffe.Extension):
    """Examples of docstrings as code."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = DOCTEST.sub(r"```pycon\n\g<0>\n```\n", obj.docstring.value)


def main() -> int:
    """The command line."""
    if not (ROOT / DOCS / "http-api.md").exists():  # not in git; the check has written it before
        subprocess.run([sys.executable, "-m", "imuscope.server.generators"], cwd=ROOT, check=True)
    state = digest()
    if STAMP.is_file() and STAMP.read_text() == state:
        print("artifacts/site: fresh")
        return 0
    shutil.rmtree(PACKAGE, ignore_errors=True)
    for path in _modules():
        place = PACKAGE / path.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, place)
    for folder in PACKAGE.rglob("*/"):
        (folder / "__init__.py").touch()
    command = [sys.executable, "-m", "mkdocs", "build", "--strict"]
    status = subprocess.run(command, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}).returncode
    if status:
        return status
    pages = sorted(SITE.rglob("*.html"))
    fetched = {match[0].decode() for page in pages for match in ELSEWHERE.finditer(page.read_bytes())}
    for text in sorted(fetched):
        print(f"fetched from elsewhere: {text}")
    if not fetched:
        STAMP.write_text(state)
        print(f"artifacts/site: {len(pages)} pages")
    return 1 if fetched else 0


def digest() -> str:
    """Of everything that the site is made from."""
    total = sha256(SOURCES.encode())
    for path in sorted(_made_from()):
        total.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()


def _made_from() -> Iterator[Path]:
    yield from (ROOT / name for name in ("mkdocs.yml", "uv.lock", *TOP))
    yield from (path for path in (ROOT / DOCS).rglob("*") if path.is_file())
    yield from (Path(__file__), ROOT / "imuscope" / "plugin.pyi", *_modules())


def _modules() -> Iterator[Path]:
    """Modules whose docstrings are shown."""
    yield from (ROOT / "imuscope" / name for name in ("recording.py", "signals.py", "results.py", "live.py"))
    yield ROOT / "imuscope" / "server" / "extensions" / "clocks" / "figures.py"
    for name, module in public_names().items():
        places = ROOT / module.replace(".", "/"), ROOT / f"{module}.{name}".replace(".", "/")
        yield from {path for place in places if (path := place.with_suffix(".py")).is_file()}


def on_config(config: Any) -> Any:
    """The navigation is that of docs/README.md: its headings, and the documents that it lists below each."""
    sections: list[dict[str, Any]] = []
    for line in (ROOT / DOCS / "README.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            sections.append({line[3:]: []})
        elif sections:
            (entries,) = sections[-1].values()
            entries += ({title[0].upper() + title[1:]: name.removeprefix("../")} for title, name in ENTRY.findall(line))
    config.nav = [{"Documentation": "README.md"}, *sections]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Documents at the top of the project are pages, too."""
    from mkdocs.structure.files import File

    for name in TOP:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(text: str, page: Any, **_: Any) -> str:
    """Links as they are in the site, and fences without the words that only our tests read."""
    if page.file.src_uri == "plugin-api.md":
        text += "\n\n" + "\n\n".join(_plugin_names())
    text = re.sub(r"^```(\w+) [\w-]+$", r"```\1", text, flags=re.MULTILINE)
    at = ROOT / (page.file.src_uri if page.file.src_uri in TOP else f"{DOCS}/{page.file.src_uri}")

    def link(results: re.Match[str]) -> str:
        words, name, anchor = results[1], results[2], results[3] or ""
        target = (at.parent / name).resolve()
        if not target.exists():
            log.warning("%s links to %s, which does not exist", at.relative_to(ROOT), name)
        inside = target.relative_to(ROOT).as_posix()
        if inside in TOP or inside.startswith(f"{DOCS}/"):
            place = os.path.relpath(inside.removeprefix(f"{DOCS}/"), Path(page.file.src_uri).parent)
            return f"[{words}]({Path(place).as_posix()}{anchor})"
        if SOURCES:
            return f"[{words}]({SOURCES}/{inside}{anchor})"
        return words if inside in words else f"{words} (`{inside}`)"

    return LINK.sub(link, text)


def _plugin_names() -> Iterator[str]:
    """Classes, functions and modules with their docstrings; then the names of the rest."""
    rest = []
    for name, module in public_names().items():
        if isinstance(getattr(imuscope.plugin, name), type | FunctionType | ModuleType):
            yield f"::: {module}.{name}"
        else:
            rest.append(f"`{name}`")
    yield f"Constants and types: {', '.join(rest)}."


if __name__ == "__main__":
    raise SystemExit(main())
