"""Keys of the bus of a fleet, version 1. docs/fleet.md specifies them and the messages published under each.

imuscope/1/robots/NAME/alive/BOOT     liveliness token of a robot
imuscope/1/robots/NAME/report         its reports, as they are made
imuscope/1/robots/NAME/journal        queryable: reports after a number, made while no fleet server was connected
imuscope/1/robots/NAME/settings       queryable: the settings of a device
imuscope/1/robots/NAME/pages/ask/SERVER       requests of a fleet server to the pages of a robot
imuscope/1/robots/NAME/pages/answer/SERVER    the robot's answers
imuscope/1/fleet/clock                queryable of the fleet server: its time
"""

import re
import unicodedata

ROOT = "imuscope/1"
ROBOTS = f"{ROOT}/robots"
FLEET = f"{ROOT}/fleet"
CLOCK = f"{FLEET}/clock"
ALL_REPORTS = f"{ROBOTS}/*/report"
ALL_TOKENS = f"{ROBOTS}/*/alive/*"
ALL_ANSWERS = f"{ROBOTS}/*/pages/answer/*"
MAX_NAME = 64
NAME_RULE = f"1 to {MAX_NAME} letters, digits, spaces, points, hyphens and underscores, a letter or a digit first"
_NAME = re.compile(rf"[^\W_][\w .-]{{0,{MAX_NAME - 1}}}")
_BOOT = re.compile(r"[0-9a-f]{16}")


def is_robot_name(text: str) -> bool:
    """Whether a text names a robot: it can be a part of a key, of an address and of a path."""
    usual = unicodedata.normalize("NFC", text)
    return bool(_NAME.fullmatch(text)) and text == usual and text.isprintable() and text == text.strip()


def numbered(name: str, number: int) -> str:
    """Name under which another robot of this name is shown; no robot can have it as its own."""
    return f"{name} ({number})"


def is_boot(text: str) -> bool:
    """Whether a text is the id of a run of a robot's server."""
    return bool(_BOOT.fullmatch(text))


def token_key(robot: str, boot: str) -> str:
    """Key of the liveliness token of a robot."""
    return f"{ROBOTS}/{robot}/alive/{boot}"


def report_key(robot: str) -> str:
    return f"{ROBOTS}/{robot}/report"


def journal_key(robot: str) -> str:
    """Key at which a robot answers with earlier reports."""
    return f"{ROBOTS}/{robot}/journal"


def settings_key(robot: str) -> str:
    """Key at which a robot answers with the settings of a device."""
    return f"{ROBOTS}/{robot}/settings"


def robot_of(key: str) -> str:
    """The robot that a key belongs to; empty if it is not a valid key of a robot."""
    name = key.removeprefix(f"{ROBOTS}/").partition("/")[0] if key.startswith(f"{ROBOTS}/") else ""
    return name if is_robot_name(name) else ""


def parse_token(key: str) -> tuple[str, str]:
    """Robot and run of a liveliness token; two empty texts for another key."""
    robot = robot_of(key)
    boot = key.rpartition("/")[2]
    return (robot, boot) if robot and is_boot(boot) and key == token_key(robot, boot) else ("", "")


def request_key(robot: str, server: str = "*") -> str:
    """Key of requests of a fleet server to the pages of a robot; of all fleet servers unless one is given."""
    return f"{ROBOTS}/{robot}/pages/ask/{server}"


def answers(server: str, robot: str = "*") -> str:
    """Key at which a robot answers a fleet server; of all robots unless one is given."""
    return f"{ROBOTS}/{robot}/pages/answer/{server}"


def server_of(key: str) -> str:
    """The fleet server that a key of pages belongs to; empty if it is not one."""
    server = key.rpartition("/")[2]
    return server if is_boot(server) else ""
