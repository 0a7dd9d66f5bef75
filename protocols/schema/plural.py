"""Counts with their nouns: the only place with the language's plural forms."""


def plural(count: int, one: str, many: str = "") -> str:
    """Noun form for a count: "gap" for 1, "gaps" for 2."""
    return one if count == 1 else many or f"{one}s"


def counted(count: int, one: str, many: str = "") -> str:
    """The count and its noun: "1 gap", "3 gaps"."""
    return f"{count} {plural(count, one, many)}"
