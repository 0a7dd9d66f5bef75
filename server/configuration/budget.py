"""Check of the link budget, the same for every change, whatever its origin (form, API, profile, file, snapshot).

    settings now ───────────────> load before ─┐
    settings with the changes ──> load after  ─┴─> more than the line carries, and more than before: refused

The load is checked against the baud rate after the changes. A device that already exceeds its budget accepts changes
that lower the load, and settings that send nothing.
"""

from collections.abc import Mapping

from imuscope.protocols.commands.transactions import Values
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.server.configuration.api_models import LoadInfo
from imuscope.server.configuration.preview import DevicePresentState, load_of
from imuscope.server.configuration.transaction_runner import group
from imuscope.server.errors import DomainError

OVER_HINT = (
    "Use fewer outputs or lower rates (“Fit to link” proposes some), or set the line to a higher baud rate first."
)
LIMIT_HINT = "Give it the rate that it had; fewer outputs or a faster line do not help."
_LOAD_TOLERANCE = 1.000_001


def overload(present: DevicePresentState, changes: Mapping[str, Values]) -> str:
    """Why the line cannot carry the outputs of the device after these changes; see `overload_error`.

    Returns:
        One sentence; "" if the line can carry the load, or the load does not grow.
    """
    error = overload_error(present, changes)
    return "" if error is None else error.message


def overload_error(present: DevicePresentState, changes: Mapping[str, Values]) -> DomainError | None:
    """Why the line cannot carry the outputs of the device after these changes, and what to do.

    Args:
        present: the device and its present settings.
        changes: settings to write, complete or in part.

    Returns:
        "too-much" of all outputs together, "bad-value" of one that cannot have this rate on any line; None if the line
        can carry the load, or the load does not grow.
    """
    merged = {**present.values, **{name: {**present.values.get(name, {}), **new} for name, new in changes.items()}}
    before = load_of(present, present.values, present.line.baud)
    after = load_of(present, merged, _baud_after(present, changes))
    if after is None:
        return None
    broken = [words for words in after.limits if before is None or words not in before.limits]
    if broken:
        return DomainError("bad-value", broken[0], LIMIT_HINT)
    share = _share(after)
    if share <= 1 or (before is not None and share <= _share(before) * _LOAD_TOLERANCE):
        return None
    rate = f" ({group(after.baud)} Bd)" if after.baud else ""
    return DomainError("too-much", f"The outputs need {max(100.1, 100 * share):.1f} % of the link{rate}.", OVER_HINT)


def _baud_after(present: DevicePresentState, changes: Mapping[str, Values]) -> int | None:
    baud = present.line.baud
    for name, new in changes.items():
        old = present.values.get(name)
        try:
            change = present.driver.line_change(name, old, {**(old or {}), **new}, present.known)
        except (KeyError, EncodeError):
            continue  # incomplete values
        if change is not None and change.baud is not None:
            baud = change.baud
    return baud


def _share(load: LoadInfo) -> float:
    return load.total / load.capacity if load.capacity else 0.0
