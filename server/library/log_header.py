"""Device information for the header of an .mtb log: the one received last, and a request where a user wants one.

    before the recording   the device sends its Configuration when it starts, and when its settings are read:
                           DeviceController.header has the last one
    while it is recorded   the same, from any request
    on request             once; the device pauses for it

The answers are recorded like all bytes; their frames are also passed to `on_result`, because a log in the vendor's own
format needs them at its beginning and takes them from the recording's metadata.
"""

from collections.abc import Callable, Mapping
from functools import partial

from imuscope.protocols.commands.transactions import DeviceRejectedError, NoReplyError
from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.family.info import LogHeader
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.configuration.device_controller import ControlError, DeviceController, JobError, RunningJob
from imuscope.server.links.base import LinkError


class LogHeaderRequest:
    """Header request of one device in one recording.

    Args:
        on_result: called with the frames, hex by name: {"configuration": "faff0d…"}, whether requested or not.
    """

    def __init__(self, controller: DeviceController, on_result: Callable[[Mapping[str, str]], None]) -> None:
        self._controller = controller
        self._on_result = on_result
        self._requested = self._is_known = False
        self._unsubscribe = controller.member.listen_to_news(self._on_news)
        if controller.header:
            self._is_known = True
            on_result(controller.header)

    def close(self) -> None:
        """Stop listening."""
        self._unsubscribe()

    @property
    def lacking(self) -> str:
        """Name of the device if its header is not in the recording and may be requested; else ""."""
        info = self._controller.member.info
        is_possible = info.status == "live" and info.link != "file" and self._header() is not None
        return info.name if is_possible and not self._is_known and not self._unasked() else ""

    def send(self) -> None:
        """Queue the request once, if the device has such a header."""
        info = self._controller.member.info
        header = self._header()
        if self._requested or header is None or info.link == "file":
            return
        self._requested = True
        if why := self._unasked():
            self._missing(why, header)
            return
        try:
            self._controller.add(header.title, partial(self._work, header=header))
        except ControlError as error:
            self._missing(error.message, header)

    def _unasked(self) -> str:
        """Reason why nothing is requested from the device; "" if it may be."""
        others = self._controller.member.access.other_users
        return f"{others} uses the device, and asking would interrupt it." if others else ""

    def _header(self) -> LogHeader | None:
        """Header of a log in the vendor's format of this device."""
        family = PROTOCOLS.get(self._controller.member.info.protocol)
        return family.logs.log_header if family is not None else None

    async def _work(self, running: RunningJob, header: LogHeader) -> None:
        controller = self._controller
        if why := self._unasked():  # by now
            raise JobError(self._missing(why, header), "The recording itself is complete.")
        try:
            await controller.run(controller.driver.within(header.request(), controller.context))
        except (DeviceRejectedError, NoReplyError, LinkError, ControlError) as error:
            raise JobError(self._missing(str(error), header), "The recording itself is complete.") from None
        running.job.message = f"Its {header.words.lower()} is in the recording."

    def _missing(self, why: str, header: LogHeader) -> str:
        name = self._controller.member.info.name
        words = f"The recording has no {header.words} of {name}, which an .{header.format} export needs: {why}"
        self._controller.bus.event(self._controller.device, "device", "warning", words)
        return words

    def _on_news(self, event: Batch | Reply) -> None:
        header = self._header() if isinstance(event, Reply) else None
        if isinstance(event, Reply) and header is not None and event.message.id in header.frames:
            frame = self._controller.member.access.bytes_at(event.offset, event.size)
            if frame:
                self._is_known = True
                self._on_result({header.frames[event.message.id]: frame.hex()})
