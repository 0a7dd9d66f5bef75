"""Reading of snapshots, which are YAML (snapshots.py), from a text that anybody may have written.

YAML is read within limits (recordings/system/bounded_yaml.py); the structure is checked here, the meaning by the
driver. PyYAML reads 5 kB in 12 ms, ruamel.yaml in 107.
"""

from datetime import UTC, datetime
from typing import Any

from imuscope.recordings.errors import check_format_version
from imuscope.recordings.system.bounded_yaml import YamlError, load
from imuscope.server.configuration.snapshots import FORMAT, MAX_TITLE, Snapshot, SnapshotError

MAX_BYTES = 1 << 18  # ten times the largest device; reading this much takes seconds


def from_text(text: str) -> Snapshot:
    """Read a snapshot.

    Raises:
        SnapshotError: the text is not a valid snapshot.
    """
    head = _mapping(_loaded(text), "A snapshot")
    if why := check_format_version("This snapshot", head.get("imuscope"), FORMAT):
        raise SnapshotError(why.message, why.hint)
    if head.get("imuscope") != FORMAT:
        raise SnapshotError(
            "This is not a snapshot of imuscope.", f"A snapshot contains `imuscope: {FORMAT}` in its first lines."
        )
    values = {}
    for name, fields in _mapping(head.get("settings") or {}, "settings").items():
        values[str(name)] = _jsonable(_mapping(fields, f"settings.{name}"), f"settings.{name}")
    missing = _mapping(head.get("missing") or {}, "missing")
    return Snapshot(
        protocol=str(head.get("protocol", "")),
        product=str(head.get("product", "")),
        serial_number=str(head.get("serial_number", "")),
        firmware=str(head.get("firmware", "")),
        title=str(head.get("title", ""))[:MAX_TITLE],
        reason=str(head.get("reason", "")),
        taken=_time(head.get("taken")),
        pinned=head.get("pinned") is True,
        imported=head.get("imported") is True,
        values=values,
        missing={str(name): str(why) for name, why in missing.items()},
    )


def _loaded(text: str) -> Any:
    try:
        return load(text, MAX_BYTES)
    except YamlError as error:
        raise SnapshotError(str(error), error.hint) from None


def _mapping(value: Any, what: str) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise SnapshotError(f"{what} must be names with values.", "Compare with a snapshot saved here.")
    return value


def _jsonable(value: Any, path: str) -> Any:
    """The value, restricted to the types of wire values."""
    if isinstance(value, dict):
        return {str(name): _jsonable(part, f"{path}.{name}") for name, part in value.items()}
    if isinstance(value, list):
        return [_jsonable(part, f"{path}.{place}") for place, part in enumerate(value)]
    if isinstance(value, int) and value.bit_length() > 64:
        raise SnapshotError(
            f"{path} is a number of more than 64 bits, which no setting can hold.", "Check whether it was edited."
        )
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise SnapshotError(f"{path} is a {type(value).__name__}, which no setting can hold.", "Quote it if it is text.")


def _time(value: Any) -> float:
    try:
        when = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
        return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return 0.0
