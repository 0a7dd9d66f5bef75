"""Packets of MIP, the family of the plug-in in tests/plugins/plugin_family, for the tests that all protocols share.

The package is not installed: its folder is put on the path.
"""

import json
import sys

from tests.support.source_files import ROOT

PACKAGE = ROOT / "tests" / "plugins" / "plugin_family"
if str(PACKAGE) not in sys.path:
    sys.path.append(str(PACKAGE))

from imuscope_mip.family import FAMILY  # noqa: E402 (its folder is on the path now)
from imuscope_mip.json_codec import frame_from_json, frame_to_json  # noqa: E402
from imuscope_mip.messages import DATA  # noqa: E402
from imuscope_mip.packets import MAX_PACKET, build  # noqa: E402
from imuscope_mip.simulator import MipSimulator  # noqa: E402

__all__ = ["DATA", "FAMILY", "MAX_PACKET", "build", "everything", "packet_of", "plain"]

plain, packet_of = frame_to_json, frame_from_json


def everything() -> list[bytes]:
    """The packets of others, and some of the simulator's."""
    vectors = [bytes.fromhex(one["packet"]) for one in json.loads((PACKAGE / "vectors.json").read_text())]
    lister = FAMILY.frames.listing()
    stream = MipSimulator(rate=50).advance(500_000_000)
    lister.feed(stream)
    lines = lister.drain(stalled=True)
    return vectors + [stream[line["offset"] : line["offset"] + line["size"]] for line in lines]
