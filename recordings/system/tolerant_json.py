"""JSON of other programs, read so that its content can be written again.

JSON can contain an unpaired surrogate ("\\ud800"). Python keeps it in a str, and nothing can encode that: neither a
file nor a response. It is read as "?", so that one odd note in a recording does not prevent the list from being sent.
"""

import json
from typing import Any


def loads(data: bytes | str) -> Any:
    """Decode JSON as json.loads does, replacing unpaired surrogates.

    Raises:
        ValueError, RecursionError: it is not JSON, or nested too deeply.
    """
    value = json.loads(data)
    if "\\u" in data if isinstance(data, str) else b"\\u" in data:
        value = json.loads(json.dumps(value, ensure_ascii=False).encode("utf-8", "replace"))
    return value
