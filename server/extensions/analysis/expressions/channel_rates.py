"""Rates of live channels, as expressions that look along time need them."""

from collections.abc import Iterator, Mapping

import numpy as np

from imuscope.server.extensions.analysis.expressions.live_expression import usual_rate
from imuscope.server.streaming.channel_store import ChannelStore

RATE_SAMPLES = 512  # that the usual rate is taken of
RATE_CHANGE = 1.2  # results of a rate that differs by this factor are discarded


class ChannelRates(Mapping[int, float]):
    """Usual rates of channels in Hz, measured when they are first requested; 0 as long as one is not known."""

    def __init__(self, store: ChannelStore) -> None:
        self._store = store
        self._known: dict[int, float] = {}

    def __getitem__(self, channel: int) -> float:
        if channel not in self._known:
            self._known[channel] = rate_of(self._store, channel)
        return self._known[channel]

    def __iter__(self) -> Iterator[int]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


def rate_of(store: ChannelStore, channel: int) -> float:
    """Usual rate of the newest samples of a channel, Hz; 0 if it is unknown."""
    stored = store.get(channel)
    if stored is None:
        return 0.0
    arrival, time = stored.ring.read(max(0, stored.ring.total - RATE_SAMPLES))[:2]
    return usual_rate(np.where(np.isnan(time), arrival, time))


def have_changed(store: ChannelStore, rates: Mapping[int, float]) -> bool:
    """Whether the rate of a channel is another one now."""
    for channel, rate in rates.items():
        now = rate_of(store, channel)
        if now > 0 and rate > 0 and not 1 / RATE_CHANGE < now / rate < RATE_CHANGE:
            return True
    return False
