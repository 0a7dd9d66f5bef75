"""A robot on the bus of a fleet without a server of its own: session, token, journal and reports."""

from __future__ import annotations

import contextlib
import threading

import zenoh

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import BusCredentials, client_settings, open_bus
from imuscope.server.extensions.fleet.model.journal import Journal
from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotEvent, RobotStatus


class FleetRobot:
    """A robot. Several can share a session, for load.

    Args:
        session: shared; None to open one in the background.
    """

    def __init__(
        self,
        name: str,
        router: str = "",
        credentials: BusCredentials | None = None,
        session: zenoh.Session | None = None,
    ) -> None:
        self.name = name
        self.journal = Journal()
        self.session = session
        self._owns = session is None
        self.opened = threading.Event()
        self._declared: list[object] = []
        self._publisher: zenoh.Publisher | None = None
        if session is not None:
            self._declare(session)
            return
        settings = client_settings(router, credentials or BusCredentials())
        threading.Thread(target=lambda: self._declare(open_bus(settings)), daemon=True).start()

    def _declare(self, session: zenoh.Session) -> None:
        self.session = session
        self._publisher = session.declare_publisher(keys.report_key(self.name))
        self._declared = [
            session.declare_queryable(keys.journal_key(self.name), self._answer),
            session.liveliness().declare_token(keys.token_key(self.name, self.journal.boot)),
        ]
        self.opened.set()

    def _answer(self, query: zenoh.Query) -> None:
        request = query.selector.parameters
        with query:
            data = self.journal.answer(
                str(request.get("boot")), int(request.get("after") or 0), earlier=bool(request.get("earlier"))
            )
            query.reply(keys.journal_key(self.name), data)

    def report(self, number: int, time: float = 1_700_000_000.0) -> None:
        """Report a status whose device has lost so many samples, and an event with the number."""
        devices = (RobotDevice("1", "MTi-630", "live", product="MTi-630 AHRS", rate=100.0, lost=number),)
        self.journal.add_event(RobotEvent(time, "marker", "info", str(number)))
        self.put(self.journal.report(time, RobotStatus(version="1.0", group="otters", devices=devices)))

    def beat(self, time: float = 1_700_000_000.0) -> None:
        """Report that nothing happened."""
        self.put(self.journal.report(time, None))

    def put(self, data: bytes) -> None:
        """Put a report, if there is a session."""
        if self._publisher is not None:
            self._publisher.put(data)

    def close(self) -> None:
        """Leave."""
        if self.session is not None and self._owns:
            with contextlib.suppress(zenoh.ZError):
                self.session.close()  # type: ignore[no-untyped-call]

    def __enter__(self) -> FleetRobot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
