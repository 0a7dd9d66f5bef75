"""Two devices on one line."""

from imuscope.server.configuration.device_controller import DeviceController
from tests.support.control_harness import ControlHarness
from tests.support.waiting import until

SOURCE = "sim:xbus?bus_ids=1,2&rate=20&baud=115200"


async def both(here: ControlHarness, source: str = SOURCE) -> list[DeviceController]:
    """Controllers of both devices of a line, the first detected one first."""
    own = await here.add(source)
    further = lambda: [desk for desk in here.desks.on_link_of(own.device) if desk is not own]  # noqa: E731
    await until(further, "the other is heard")
    desks = [own, *further()]
    await until(lambda: all(desk.context.device for desk in desks), "their addresses are sure")
    return desks
