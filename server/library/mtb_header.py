"""How does a recording come to hold what a log of its device begins with? It is asked, once, when it is heard.

The answers come like any bytes and are in the recording as such; their frames are also told to `tell`, because whoever
makes a log of the device's own format of it (.mtb) needs them first, and finds them in the recording's metadata.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from protocols.events import Event, Reply
from protocols.transactions import DeviceRejectedError, NoReplyError
from protocols.xbus.log_header import CONFIGURATION, EMTS_DATA, head
from server.configuration.device_controller import ControlError, DeviceController, JobError, QueuedJob
from server.links.base import LinkError

FRAMES = {CONFIGURATION: "configuration", EMTS_DATA: "emts"}
TITLE = "Read its configuration, for the recording"


class MtbHeader:
    """Of one device in one recording.

    Args:
        tell: hears the frames, hex by name: {"configuration": "faff0d…"}, whenever one came, asked for or not.
    """

    def __init__(self, desk: DeviceController, tell: Callable[[Mapping[str, str]], None]) -> None:
        self._desk = desk
        self._tell = tell
        self._asked = False
        self._off = desk.session.listen(self._hear)

    def close(self) -> None:
        """Hear no more."""
        self._off()

    def ask(self) -> None:
        """Put the question into the device's queue, unless that was done, or it has no such thing."""
        info = self._desk.session.info
        if self._asked or info.protocol != "xbus" or info.link == "file":
            return
        self._asked = True
        try:
            self._desk.add(TITLE, self._work)
        except ControlError as error:
            self._missing(error.message)

    async def _work(self, task: QueuedJob) -> None:
        desk = self._desk
        try:
            await desk.run(desk.driver.within(head(), desk.known))
        except (DeviceRejectedError, NoReplyError, LinkError, ControlError) as error:
            raise JobError(self._missing(str(error)), "The recording itself is complete.") from None
        task.job.message = "Its configuration is in the recording."

    def _missing(self, why: str) -> str:
        name = self._desk.session.info.name
        words = f"The recording has no Configuration of {name}, which an .mtb export needs: {why}"
        self._desk.hub.event(self._desk.device, "device", "caution", words)
        return words

    def _hear(self, event: Event) -> None:
        if isinstance(event, Reply) and event.message.id in FRAMES and self._desk.session.info.protocol == "xbus":
            frame = self._desk.session.bytes_at(event.offset, event.size)
            if frame:
                self._tell({FRAMES[event.message.id]: frame.hex()})
