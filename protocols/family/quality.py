"""Ladder of a protocol family: what it offers beyond decoding, level by level.

    first light   its bytes are found, decoded and listed: the required fields of ProtocolInfo
    bronze        its devices have names, its messages a reference, and a simulator stands in for hardware
    silver        losses are counted, settings are written and read back, the port is shared by whole frames
    gold          what only some devices have: times in UTC, positions, vendor logs, corrections, properties of sensors

A family fulfils each rule or says why the rule does not apply to it (PageWords.exempt). docs/supported-devices.md shows
the ladder of every installed family.
"""

from collections.abc import Callable
from dataclasses import dataclass

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.family.info import DeviceTraits, ProtocolInfo, StreamTraits

LEVELS = ("first light", "bronze", "silver", "gold")


@dataclass(frozen=True, slots=True)
class QualityRule:
    """One rule.

    Args:
        name: in PageWords.exempt.
        level: that it belongs to.
        words: what a family offers, for a table.
        is_fulfilled: whether a family does.
    """

    name: str
    level: str
    words: str
    is_fulfilled: Callable[[ProtocolInfo], bool]


RULES = (
    QualityRule("messages", "bronze", "Messages in the reference", lambda family: bool([*family.frames.rows()])),
    QualityRule(
        "products", "bronze", "Tables of products and firmware", lambda family: bool([*family.page.supported()])
    ),
    QualityRule("simulator", "bronze", "A simulated device", lambda family: family.simulator is not None),
    QualityRule(
        "identity", "bronze", "Product and serial number without an interruption", lambda family: _is_identified(family)
    ),
    QualityRule(
        "losses", "silver", "Lost samples counted by numbers of the device", lambda family: family.stream.counts
    ),
    QualityRule("compose", "silver", "Frames from words and JSON", lambda family: family.frames.composer is not None),
    QualityRule("settings", "silver", "Settings by form, read back", lambda family: _has_settings(family)),
    QualityRule("sharing", "silver", "Whole frames on a shared port", lambda family: bool(family.frames.frame_size)),
    QualityRule(
        "clients",
        "silver",
        "Changes made by other programs on a shared port",
        lambda family: bool(family.frames.configuration_frames),
    ),
    QualityRule("utc", "gold", "Times in UTC", lambda family: _differs(family.stream, StreamTraits(), "utc")),
    QualityRule("position", "gold", "Positions", lambda family: _differs(family.device, DeviceTraits(), "position")),
    QualityRule(
        "sensors",
        "gold",
        "Axes and noise of the sensors",
        lambda family: _differs(family.device, DeviceTraits(), "sensors"),
    ),
    QualityRule("logs", "gold", "Files of the vendor's programs", lambda family: bool(family.logs.log_formats)),
    QualityRule(
        "corrections",
        "gold",
        "RTCM corrections",
        lambda family: family.configuration.corrections is not None,
    ),
    QualityRule(
        "mounting", "gold", "Mounting rotation as a setting", lambda family: family.configuration.mounting is not None
    ),
)


def _is_identified(family: ProtocolInfo) -> bool:
    return bool(family.device.identify_request) or bool(family.device.sender)


def _has_settings(family: ProtocolInfo) -> bool:
    driver = family.configuration.driver
    return driver is not None and bool(driver.settings(DeviceContext()))


def _differs(traits: object, usual: object, name: str) -> bool:
    """Whether a family has a function of its own."""
    return getattr(traits, name) is not getattr(usual, name)


def gaps(family: ProtocolInfo) -> list[QualityRule]:
    """The rules that a family neither fulfils nor is exempt from."""
    return [rule for rule in RULES if not rule.is_fulfilled(family) and rule.name not in family.page.exempt]


def level_of(family: ProtocolInfo) -> str:
    """The highest level whose rules, and those below it, are fulfilled or do not apply."""
    missing = {rule.level for rule in gaps(family)}
    reached = LEVELS[0]
    for level in LEVELS[1:]:
        if level in missing:
            break
        reached = level
    return reached
