"""Settings of a fleet in the configuration file: `[fleet]` of a robot, `[fleet_server]` of `imuscope fleet`.

[fleet]
router = "tls/fleet.example:7447"
user = "otter-7"
password = "@/etc/imuscope/fleet-password"
"""

from dataclasses import dataclass, field
from typing import Annotated

from annotated_types import Interval, Unit

from imuscope.server.settings.setting_types import Form, empty_or, is_router_address, zero_or

_RouterOfRobot = Annotated[
    str,
    empty_or(is_router_address, "is not an address such as tcp/fleet.example:7447 or tls/fleet.example:7447"),
]
_Address = Annotated[
    str, empty_or(is_router_address, "is not an address such as tcp/127.0.0.1:7447 or tls/0.0.0.0:7447")
]


@dataclass(frozen=True, slots=True)
class FleetSettings:
    """Membership of a robot in a fleet (server/extensions/fleet/robot/publisher.py).

    Args:
        router: address of the fleet server, or of a Zenoh router before it; "" for no fleet.
        name, group: of the robot; "" for the name of this host, and for no group.
        address: of its own page, for links.
        user, password: at the router; the password may be @FILE.
        ca, certificate, key: PEM files: authority of the router's certificate, and the robot's own certificate.
        limit_kb_s: most bytes/s that are sent, 10³ bytes; 0 for no limit.
        pages: what the fleet server may do with the pages of this robot: "off", "view" or "control".
    """

    router: _RouterOfRobot = ""
    name: str = ""
    group: str = ""
    address: str = ""
    user: str = ""
    password: str = field(default="", repr=False)
    ca: str = ""
    certificate: str = ""
    key: str = ""
    limit_kb_s: Annotated[float, zero_or(0.1, 1e6, "kB/s")] = 0.0
    pages: Annotated[str, Form(("off", "view", "control").__contains__, "is not off, view or control")] = "view"


@dataclass(frozen=True, slots=True)
class FleetServerSettings:
    """The bus of a fleet server (server/extensions/fleet/server/fleet_server.py).

    Args:
        listen: address for robots; "" for none.
        router: address of a Zenoh router to use instead.
        robots: file of the robots that may connect, with their passwords (server/extensions/fleet/model/access.py).
        operators: file of users who may command some groups (server/extensions/fleet/model/operators.py).
        anyone: anyone on the network may join and listen.
        certificate, key, ca: PEM files: certificate of this server, and the authority of the other side's.
        user, password: at the router; the password may be @FILE.
        alarm_lost_s: a robot that is lost for longer raises an alarm; 0 for none.
        alarm_loss_percent: the same for a device that loses a larger share of its samples in a minute, %.
        alarm_settings: the same for settings that differ from the profile of the group.
        alarm_disk_gb: the same for less free space, 10⁹ bytes.
        alarm_webhook: address to which changes of these alarms are posted; "" for none.
    """

    listen: _Address = ""
    router: _Address = ""
    robots: str = ""
    operators: str = ""
    anyone: bool = False
    certificate: str = ""
    key: str = ""
    ca: str = ""
    user: str = ""
    password: str = field(default="", repr=False)
    alarm_lost_s: Annotated[float, Interval(ge=0, le=1e7), Unit("s")] = 60.0
    alarm_loss_percent: Annotated[float, Interval(ge=0, le=100), Unit("%")] = 1.0
    alarm_settings: bool = True
    alarm_disk_gb: Annotated[float, Interval(ge=0, le=1e6), Unit("GB")] = 2.0
    alarm_webhook: str = field(default="", repr=False)
