"""A recording of devices with known bytes."""

from pathlib import Path

from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.writer import McapWriter
from tests.server.links.link_fixtures import frame

START = 1_760_000_000_000_000_000


def device_bytes(device: int, n: int) -> bytes:
    return frame(n, n * 100, bytes([0x80 if device == 1 else 0x40, 0x20, 12]) + bytes(12))


def recording(folder: Path, devices: int = 2, frames: int = 100) -> Path:
    """A frame of each device every 10 ms."""
    path = folder / "drive.mcap"
    writer = McapWriter(path, {})
    for device in range(1, devices + 1):
        writer.device(str(device), {"protocol": "xbus", "source": f"/dev/ttyUSB{device}"})
    for n in range(frames):
        for device in range(1, devices + 1):
            writer.chunk(str(device), "rx", device_bytes(device, n), START + n * 10_000_000 + device)
    writer.close()
    compact(path)
    return path


def of(device: int, first: int = 0, last: int = 100) -> bytes:
    return b"".join(device_bytes(device, n) for n in range(first, last))
