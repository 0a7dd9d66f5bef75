"""Opening files in tests: their columns, and what becomes of them when they are damaged."""

import random
from pathlib import Path

import numpy as np
from hypothesis import settings

from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.options import TableOptions
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode

FLIPS = settings.default.max_examples // 3
CUTS = FLIPS // 2


def opened(path: Path, folder: Path, table: TableOptions | None = None) -> ColumnStore:
    """The columns of a file."""
    return decode(open_file(path, "", table), folder / "columns", protocol_set.all_protocols())


def rows_of(store: ColumnStore, name: str, message: str = "") -> ExactRows:
    """All rows of a channel; of messages, `name` is that of the quantity."""
    names = (name, f"{message}.{name}")
    info = next(
        one
        for one in store.manifest["channels"]
        if message in ("", one["message"]) and (one["name"] in names or one["name"].endswith(f".{name}"))
    )
    return store.exact(info["id"], 0, 1 << 40)


def damage_of(store: ColumnStore) -> str:
    """All words on damage and on what was left out."""
    return " ".join(one["words"] for one in store.manifest["damage"])


def survives_damage(path: Path, folder: Path) -> tuple[int, int]:
    """Open a file with flipped bits, cut, and with huge numbers in it; any error but a RecordingError is a failure.

    Returns:
        how many were opened, and refused.
    """
    whole, chance = path.read_bytes(), random.Random(0)
    damaged = [whole[: chance.randrange(1, len(whole))] for _ in range(CUTS)]
    for number in range(FLIPS):
        data = bytearray(whole)
        within = len(data) if number % 2 else min(len(data), 4096)
        for _ in range(chance.choice((1, 3, 40))):
            data[chance.randrange(within)] ^= 1 << chance.randrange(8)
        damaged.append(bytes(data))
        at = chance.randrange(within)
        damaged.append(whole[:at] + b"\xff" * chance.choice((2, 4, 8)) + whole[at + 4 :])
    opens = refused = 0
    for number, data in enumerate(damaged):
        copy = folder / f"damaged-{number}{path.suffix}"
        copy.write_bytes(data)
        try:
            store = decode(open_file(copy), folder / f"store-{number}", protocol_set.all_protocols())
        except RecordingError:
            refused += 1
        else:
            opens += 1
            assert all(np.isfinite(store.manifest[name] or 0.0) for name in ("started", "ended"))
        copy.unlink()
    return opens, refused
