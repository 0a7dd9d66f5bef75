"""Shared parts of the commands that generate files from the server."""

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


def write(files: Iterable[tuple[Path, str]]) -> None:
    """Write the files that are not there, or differ."""
    for path, text in files:
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(path)
