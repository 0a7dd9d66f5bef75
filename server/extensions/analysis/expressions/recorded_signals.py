"""Computed signals of recordings: definitions recorded with the bytes ─> channels of the decoded recording.

    signals/<device> of the file ─> expressions over the decoded columns ─> columns, as any others

So plots, values and exports have them without knowing of expressions. Filters and moving windows are without delay,
forwards and backwards. A definition that does not fit the recording is an event, and the rest is opened.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.derived_channels import channel_of, in_order
from imuscope.server.extensions.analysis.expressions.expression_functions import Context
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal, expression_over
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, recorded_samples
from imuscope.server.library.collector import RecordingSink
from imuscope.server.library.computed_signals import SignalComputation
from imuscope.server.library.recording_detail import channels_of, segments_of
from imuscope.server.library.signal_definitions import SignalDefinition, definitions_in
from imuscope.server.wire import ChannelInfo

WHOLE = Context(zero_phase=True)


def add_computed_signals(store: ColumnStore, definitions: Mapping[str, Any], sink: RecordingSink) -> None:
    """Add the channels of computed signals; see server/library/decode.py, ComputeSignals."""
    computed = _ComputedSignals(store, sink)
    for device, rows in definitions.items():
        for definition in in_order(definitions_in(rows)):
            try:
                computed.add(device, definition)
            except DomainError as error:
                _report(sink, device, definition, error.text)
            except MemoryError:
                _report(sink, device, definition, "it needs too much memory for a recording of this length.")


def _report(sink: RecordingSink, device: str, definition: SignalDefinition, why: str) -> None:
    words = f"The computed signal “{definition.name}” is left out: {why}"
    data = {"reason": "computed", "name": definition.name, "expression": definition.expression}
    sink.event(device, "device", "warning", words, data=data)


class _ComputedSignals:
    """Signals computed over the columns of a recording, each available to those that follow."""

    def __init__(self, store: ColumnStore, sink: RecordingSink) -> None:
        self._store, self._sink = store, sink
        self._infos: list[ChannelInfo] = list(channels_of(store).values())
        self._made: dict[int, tuple[Floats, Sequence[Floats]]] = {}

    def add(self, device: str, definition: SignalDefinition) -> None:
        """Compute a signal and write its channel.

        Raises:
            DomainError: it does not fit the recording.
        """
        if any(info.device == device and info.name == definition.name for info in self._infos):
            raise DomainError("name", "the device sends a channel of that name.", "Give the signal another name.")
        segments = segments_of(self._store)
        signal = expression_over(self._infos, definition.expression, WHOLE, device, segments=segments)
        value = signal.quantity(self._read)
        assert value.time is not None  # it is not a number
        described = channel_of(device, definition, value)
        described.doc = " ".join([described.doc, *(f"{note}" for note in signal.notes)])
        number = self._sink.advertise(described)
        self._infos.append(replace(described, id=number))
        self._made[number] = value.time, value.parts
        self._sink.keep_computed(number, [self._arrival(signal, value), value.time, *value.parts])

    def _read(self, column: SignalColumn) -> tuple[Floats, Floats]:
        made = self._made.get(column.info.id)
        if made is None:
            return recorded_samples(self._store, column, -math.inf, math.inf)
        return made[0], made[1][column.at]

    def _arrival(self, signal: ExpressionSignal, value: Quantity) -> Floats:
        """Arrival of the samples: that of the samples from which they have their times."""
        stored = [one.info.id for one in signal.columns if one.info.id not in self._made]
        assert value.time is not None
        if not stored or not len(value.time):
            return value.time
        source = max(stored, key=self._store.rows)
        key, arrival = (self._store.clock(source, 0, self._store.rows(source), name) for name in ("key", "arrival"))
        arrivals: Floats = np.interp(value.time, key, np.maximum.accumulate(arrival)) if len(key) else value.time
        return arrivals


COMPUTED = SignalComputation("analysis", add_computed_signals)
