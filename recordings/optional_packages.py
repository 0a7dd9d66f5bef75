"""Packages that a smaller installation lacks, and how to add them (docs/guide/deployment.md).

An extra of pyproject.toml names them by distribution, this table by the module that is imported.
"""

from importlib.util import find_spec

EXTRAS = {
    "viewers": ("rerun", "viser", "msgspec", "foxglove"),
    "ros2": ("zenoh", "xxhash", "msgspec"),
    "fleet": ("zenoh", "msgspec", "deltalake", "obstore", "duckdb"),
}
"""Modules of each extra."""


def lacks(*modules: str) -> bool:
    """Whether one of these modules is not installed."""
    return any(find_spec(module) is None for module in modules)


def installation_of(extra: str) -> str:
    """The command that adds an extra."""
    return f"pip install 'imuscope[{extra}]'"
