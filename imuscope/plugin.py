"""Public names for plug-ins: a protocol family, a link, an exporter, an analysis in a package of its own.

    from imuscope.plugin import Analysis, AnalysisOption, register_analysis

plugin.pyi lists the names; only these are public. `API_VERSION` grows when one of them changes its meaning or is
removed, and a plug-in that is written for another version is refused in one sentence. A plug-in says its version with
the name of its entry-point group: `imuscope.protocols` for version 1, `imuscope.protocols.2` for version 2.

A name is imported when it is used, so that a protocol family loads nothing of the server.
"""

import ast
import functools
from importlib import import_module
from pathlib import Path
from typing import Any


@functools.cache
def public_names() -> dict[str, str]:
    """Public name → module that has it, in the order of plugin.pyi."""
    listed = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = (node for node in listed.body if isinstance(node, ast.ImportFrom) and node.module)
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> Any:
    """One of the public names.

    Raises:
        AttributeError: it is not public, or not of this version of the plug-in API.
    """
    module = public_names().get(name)
    if module is None:
        raise AttributeError(f"{name!r} is not a public name of imuscope {__name__}")
    target = import_module(module)
    return getattr(target, name) if hasattr(target, name) else import_module(f"{module}.{name}")


def __dir__() -> list[str]:
    return sorted(public_names())
