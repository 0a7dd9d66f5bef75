"""The ladder of protocol families: each rule is fulfilled, or a reason says why it does not apply."""

from dataclasses import replace

from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.family.quality import LEVELS, RULES, gaps, level_of
from imuscope.protocols.registry.families import PROTOCOLS
from tests.support.each_row import each_row


@each_row("family", [*PROTOCOLS.values()])
def test_our_families_leave_no_rule_open(family: ProtocolInfo) -> None:
    assert [rule.name for rule in gaps(family)] == []
    names = {rule.name for rule in RULES}
    for name, reason in family.page.exempt.items():
        assert name in names
        assert reason.endswith(".")
        assert not next(rule for rule in RULES if rule.name == name).is_fulfilled(family), f"{name} is fulfilled"


def test_a_gap_ends_the_ladder() -> None:
    family = PROTOCOLS["xbus"]
    assert level_of(family) == "gold"
    assert level_of(replace(family, simulator=None)) == LEVELS[0]
    assert level_of(replace(family, stream=replace(family.stream, counts=False))) == "bronze"


def test_rules_are_in_the_order_of_their_levels() -> None:
    assert [rule.level for rule in RULES] == sorted((rule.level for rule in RULES), key=LEVELS.index)
