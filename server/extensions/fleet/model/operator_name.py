"""Names of users who do something for a fleet."""

from imuscope.server.errors import DomainError

MAX_BY = 60  # characters


def operator_name(by: str) -> str:
    """The name of a user in one line.

    Raises:
        DomainError: it is missing or too long.
    """
    name = " ".join(by.split())
    if not name or len(name) > MAX_BY or not name.isprintable():
        raise DomainError("bad-value", "by: give the name of the person who does this.", f"Up to {MAX_BY} characters.")
    return name
