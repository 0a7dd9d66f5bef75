"""Streams of all families as files, slightly damaged: those of the benchmarks, and all vectors of Xbus."""

from pathlib import Path

from tests.bench.support import idtp_mixed, isb_mixed
from tests.protocols.decoder_digests import PIECE
from tests.protocols.xbus import xbus_vectors


def write_streams(folder: Path) -> None:
    """Write a file for each family, which it is named after."""
    for name, data in (
        ("isb", isb_mixed.stream(4.0)),
        ("idtp", idtp_mixed.mixed(6.0)),
        ("xbus", b"".join(xbus_vectors.everything()) * 9),
    ):
        noisy = bytearray(data)
        noisy[1000::7001] = bytes(len(noisy[1000::7001]))
        assert len(noisy) > 4 * PIECE
        (folder / name).write_bytes(noisy)
