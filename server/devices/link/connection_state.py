"""State machine of a session's connection: the states, the events and the transitions.

The table is drawn in docs/architecture.md, by `python -m tests.rules.architecture_pictures`. A link that FAILED is
retried after a pause or on request; one that is FINISHED (a file is over, or the source cannot be used) on request
only. Both may happen while a link is being opened or is open. CLOSE may happen in any state, and REOPEN in all but
CLOSED: a transaction closes the link and opens it again, for example at another rate.

An event without a row for the state is a programming error and is rejected (`IllegalTransitionError`); the state does
not change. To add a state, add its row and list it in `OPEN_STATES` if its link is open; to add an event, add its
target to every row in which it is legal. The table alone decides whether a transition is legal.

The status on the page (wire.DeviceStatus) follows from the state, with one deliberate exception: OPENING and WAITING
keep the previous status, so that an error stays readable during a retry.
"""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class ConnectionState(Enum):
    """State of the link of a session."""

    CLOSED = "closed"  # not started, or ended
    OPENING = "opening"
    WAITING = "waiting"  # open; nothing was decoded yet
    LIVE = "live"
    SILENT = "silent"  # open; no more data, or no decodable data
    RETRYING = "retrying"  # not open; retried after a pause
    STOPPED = "stopped"  # not open; retried on request


class ConnectionEvent(Enum):
    """Event that moves a connection from state to state."""

    START = "start"
    OPENED = "opened"
    DECODED = "decoded"  # samples
    SILENCE = "silence"
    FAILED = "failed"
    FINISHED = "finished"
    RETRY = "retry"
    REOPEN = "reopen"
    CLOSE = "close"


_S, _E = ConnectionState, ConnectionEvent
_LEAVING = {_E.FAILED: _S.RETRYING, _E.FINISHED: _S.STOPPED, _E.REOPEN: _S.OPENING, _E.CLOSE: _S.CLOSED}

TRANSITIONS: Mapping[ConnectionState, Mapping[ConnectionEvent, ConnectionState]] = MappingProxyType(
    {
        _S.CLOSED: {_E.START: _S.OPENING, _E.CLOSE: _S.CLOSED},
        _S.OPENING: {_E.OPENED: _S.WAITING, **_LEAVING},
        _S.WAITING: {_E.DECODED: _S.LIVE, _E.SILENCE: _S.SILENT, **_LEAVING},
        _S.LIVE: {_E.SILENCE: _S.SILENT, **_LEAVING},
        _S.SILENT: {_E.DECODED: _S.LIVE, _E.SILENCE: _S.SILENT, **_LEAVING},  # no data, then none that decodes
        _S.RETRYING: {_E.RETRY: _S.OPENING, _E.REOPEN: _S.OPENING, _E.CLOSE: _S.CLOSED},
        _S.STOPPED: {_E.RETRY: _S.OPENING, _E.REOPEN: _S.OPENING, _E.CLOSE: _S.CLOSED},
    }
)
OPEN_STATES = frozenset({_S.WAITING, _S.LIVE, _S.SILENT})


class IllegalTransitionError(Exception):
    """An event that is not legal in a state."""

    def __init__(self, state: ConnectionState, event: ConnectionEvent) -> None:
        known = ", ".join(one.value for one in TRANSITIONS[state])
        super().__init__(f"The event {event.value} is not legal in state {state.value}; legal are: {known}.")
        self.state, self.event = state, event


class Connection:
    """The machine of one session."""

    def __init__(self) -> None:
        self._state = ConnectionState.CLOSED

    @property
    def state(self) -> ConnectionState:
        return self._state

    @property
    def is_open(self) -> bool:
        return self._state in OPEN_STATES

    def allows(self, event: ConnectionEvent) -> bool:
        """The event is legal now."""
        return event in TRANSITIONS[self._state]

    def apply(self, event: ConnectionEvent) -> ConnectionState:
        """Apply an event and return the new state.

        Raises:
            IllegalTransitionError: the event is not legal in this state; the state is unchanged.
        """
        try:
            self._state = TRANSITIONS[self._state][event]
        except KeyError:
            raise IllegalTransitionError(self._state, event) from None
        return self._state
