"""Number of lines: hand-written sources stay below their ceiling."""

from tests.rules.count_lines import CEILING, counts, total


def test_sources_stay_below_their_ceiling() -> None:
    lines = total(counts(), "sources")
    assert lines <= CEILING, f"{lines:,} lines; simplify, or raise CEILING and say what for"
