"""Text from devices and files, made harmless for a terminal: what is no visible character is spelled.

A device chooses its own name, and a sentence may hold any byte: printed as they came, escape sequences would move the
cursor, rename the window or colour what follows. So nothing of a device reaches a terminal but through one of these.
"""

from __future__ import annotations

import json
import re
from typing import Any

_ODD = re.compile(r"[^\x20-\x7e]")  # looked at more closely


def printable(text: str) -> str:
    """Text for a person: a character that cannot be seen as \\x1b, \\x85, \\u2028."""
    return text if text.isprintable() else "".join(one if one.isprintable() else repr(one)[1:-1] for one in text)


def json_text(value: Any, **how: Any) -> str:
    """A value as JSON for people and programs: readable, and with every character escaped that cannot be seen.

    Args:
        how: of json.dumps.
    """
    text = json.dumps(value, ensure_ascii=False, **how)
    return text if text.isprintable() else _ODD.sub(_escaped, text)


def _escaped(found: re.Match[str]) -> str:
    one = found[0]
    return one if one.isprintable() or one == "\n" else json.dumps(one)[1:-1]
