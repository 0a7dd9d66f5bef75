"""`python -m tests.protocols.decoder_digests FOLDER`: what the decoders give for the files there, as digests.

Needs nothing but the protocols, so that it runs wherever they do. A file is named like its family.
"""

import hashlib
import sys
from pathlib import Path

from imuscope.protocols.events import Batch
from imuscope.protocols.native import kernels as compiled
from imuscope.protocols.registry.families import PROTOCOLS

PIECE = 25_000


def digests(folder: Path) -> dict[str, str]:
    """By family."""
    each = {}
    for path in sorted(folder.iterdir()):
        decoder = PROTOCOLS[path.name].decoding.decoder()
        digest, data = hashlib.sha256(), path.read_bytes()
        for at in range(0, len(data), PIECE):
            decoder.feed(data[at : at + PIECE], at)
            for event in decoder.drain(stalled=at + PIECE >= len(data)):
                if isinstance(event, Batch):
                    rows = [(name, column.dtype.descr, column.tobytes()) for name, column in event.columns.items()]
                    digest.update(repr((event.message.name, len(event), event.offset.tobytes(), rows)).encode())
        each[path.name] = digest.hexdigest()
    return each


if __name__ == "__main__":
    print(len(compiled.missing()), digests(Path(sys.argv[1])))
