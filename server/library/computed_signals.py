"""Door for what computes signals of recordings: an entry point, so that decoding knows no expressions.

    [project.entry-points."imuscope.computed_signals"]
    analysis = "imuscope.server.extensions.analysis.expressions.recorded_signals:COMPUTED"

`COMPUTED` is a SignalComputation of that name.

Definitions are recorded with the bytes of a device; a decoded recording has their channels, as any others.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.family.plugins import each_usable, plugins_of
from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.library.collector import RecordingSink
from imuscope.server.library.decode import ComputeSignals

GROUP = "imuscope.computed_signals"


@dataclass(frozen=True, slots=True)
class SignalComputation:
    """One way to compute signals.

    Args:
        name: of its entry point.
        compute: adds the channels of the definitions that it knows.
    """

    name: str
    compute: ComputeSignals


def compute_signals(store: ColumnStore, definitions: Mapping[str, Any], sink: RecordingSink) -> None:
    """Add the channels of computed signals to a decoded recording (server/library/decode.py, ComputeSignals).

    If nothing installed computes them, an event says how many are left out.
    """
    installed = [plugin for plugin in plugins_of(GROUP) if plugin.is_there]
    for problem in each_usable(
        installed, "computation", lambda plugin: plugin.load(SignalComputation).compute(store, definitions, sink)
    ):
        sink.event(next(iter(definitions)), "device", "warning", problem, data={"reason": "computed"})
    if installed:
        return
    for device, rows in definitions.items():
        if isinstance(rows, list) and rows:
            words = f"Computed signals are left out ({len(rows)}): the analysis extension is not installed."
            sink.event(device, "device", "warning", words, data={"reason": "computed", "count": len(rows)})
