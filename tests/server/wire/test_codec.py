"""The frames of tests/golden/wire/frames.json, read by Python and TypeScript: what one writes the other understands.

Each entry says in words what it is, gives the header and the columns as numbers (null for NaN, a decimal string for a
64-bit integer) and the bytes. This test encodes the numbers again; web/src/wire/codec.test.ts decodes the bytes.
`python -m tests.server.wire.test_codec` writes the bytes anew after the wire has changed on purpose.
"""

import json
from typing import Any

import numpy as np

from imuscope.server.wire.codec import encode_samples
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "wire" / "frames.json"
ENTRIES: list[dict[str, Any]] = json.loads(GOLDEN.read_text())["frames"]


def encoded(entry: dict[str, Any]) -> bytes:
    columns = [
        np.array([np.nan if v is None else int(v) if isinstance(v, str) else v for v in values], dtype=dtype)
        for dtype, values in zip(["f8", "f8", *entry["dtypes"]], entry["columns"], strict=True)
    ]
    return encode_samples(
        entry["channel"],
        entry["sequence"],
        columns,
        entry["now"],
        history=entry["history"],
        dropped=entry["dropped"],
    )


@each_row("entry", ENTRIES, ids=[entry["what"] for entry in ENTRIES])
def test_frame_is_as_it_was(entry: dict[str, Any]) -> None:
    assert encoded(entry).hex() == entry["hex"]


if __name__ == "__main__":
    whole = json.loads(GOLDEN.read_text())
    for entry in whole["frames"]:
        entry["hex"] = encoded(entry).hex()
    GOLDEN.write_text(json.dumps(whole, indent=1) + "\n")
