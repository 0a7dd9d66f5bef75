"""Text from devices and files, made safe for a terminal: characters that are not visible are escaped.

A device chooses its own name, and its texts may contain any byte: escape sequences, printed unchanged, would move the
cursor, rename the window or change colours. So all text of a device goes through one of these functions.
"""

import json
import re
from typing import Any

_ODD = re.compile(r"[^\x20-\x7e]")  # candidates; visible ones are not escaped


def printable(text: str) -> str:
    """Text for reading; characters that are not printable as \\x1b, \\x85, \\u2028."""
    return text if text.isprintable() else "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def json_text(value: Any, **how: Any) -> str:
    """A value as JSON, readable, with every character escaped that is not printable.

    Args:
        how: arguments of json.dumps.
    """
    text = json.dumps(value, ensure_ascii=False, **how)
    return text if text.isprintable() else _ODD.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    one = match[0]
    return one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1]
