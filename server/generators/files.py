"""Shared parts of the commands that generate files from the server."""

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imuscope.server.access.auth import Access, Guard
from imuscope.server.app.application import Application
from imuscope.server.app.build import create_app
from imuscope.server.settings.config import Config


def document() -> dict[str, Any]:
    """The OpenAPI document of the server."""
    with tempfile.TemporaryDirectory() as folder:
        config = Config(data=Path(folder))
        guarded = create_app(config, Access(config))
    assert isinstance(guarded, Guard)
    assert isinstance(guarded.app, Application)
    return guarded.app.framework().openapi()


def write(files: Iterable[tuple[Path, str]], arguments: list[str], module: str) -> int:
    """Write the files, or with --check only say which are stale; returns the exit status."""
    stale = 0
    for path, text in files:
        if "--check" not in arguments:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(path)
        elif not path.exists() or path.read_text(encoding="utf-8") != text:
            print(f"{path} is stale: run python -m imuscope.server.{module}", file=sys.stderr)
            stale = 1
    return stale
