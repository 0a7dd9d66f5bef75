"""Warnings of a decoder become sentences in the event log."""

from pathlib import Path

from imuscope.protocols.idtp.frames import build
from imuscope.recordings.importers.open_file import open_file
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode


def test_a_warning_is_the_sentence_and_not_its_fields(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(b"".join(build(4, bytes(8), timestamp=10_000 * i, sequence=i, device=1) for i in range(50)))
    store = decode(open_file(path), tmp_path / "store", protocol_set.all_protocols())
    texts = [event["text"] for event in store.manifest["events"] if event["kind"] == "reply"]
    assert texts == ["Imu9 has 8 bytes instead of 36 and is not decoded."]
