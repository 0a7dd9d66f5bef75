"""JSON that somebody else wrote: read so that what it says can be written again.

JSON can name half a character ("\\ud800"). Python keeps it in a str, and nothing can encode that: neither a file nor an
answer. It is read as "?", so that one odd note in a recording does not keep the whole list from being sent.
"""

from __future__ import annotations

import json
from typing import Any


def loads(data: bytes | str) -> Any:
    """As json.loads, with whole characters.

    Raises:
        ValueError, RecursionError: it is no JSON, or nested without end.
    """
    value = json.loads(data)
    if "\\u" in data if isinstance(data, str) else b"\\u" in data:
        value = json.loads(json.dumps(value, ensure_ascii=False).encode("utf-8", "replace"))
    return value
