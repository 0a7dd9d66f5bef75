"""Messages in MCAP files, of imuscope's recordings and of other programs, as the stream of protocols/messages/.

    imuscope's own    a channel of a device has its id in the metadata `imuscope.device`; its messages are as they came
    of others         all channels together are one device (recordings/readers/message_source.py)

The arrival of a message is its log time.
"""

from collections.abc import Callable, Iterator

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.records import MESSAGE_HEAD, MessageChannel, definition
from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, TIME, McapReader, MessageBlock
from imuscope.recordings.mcap.writer import DEVICE_KEY

_HEAD = MESSAGE_HEAD.size


class MessageBlocks:
    """Reads the messages of a file as chunks of the stream, each channel defined before its first message.

    Args:
        device_of: the device of a channel; "" to leave it out.
    """

    def __init__(self, recording: McapReader, device_of: Callable[[MessageChannel], str]) -> None:
        self._recording = recording
        self._device_of = device_of
        self._devices: dict[int, str] = {}
        self._defined: set[int] = set()

    def of(self, block: MessageBlock) -> Iterator[tuple[str, bytes, Ints, Ints]]:
        """The messages of a block by device, in the order of the file: device, records, end and time of each."""
        table = block.table
        numbers: dict[str, list[int]] = {}
        for number in np.unique(table[CHANNEL_ID]).tolist():
            if device := self._device(number):
                numbers.setdefault(device, []).append(number)
        for device, some in numbers.items():
            rows = np.ascontiguousarray(table[:, np.isin(table[CHANNEL_ID], some)])
            new = [number for number in some if number not in self._defined]
            self._defined.update(new)
            head = b"".join(definition(self._recording.topics[number]) for number in new)
            data, ends = _records(block, rows)
            yield device, head + data, ends + len(head), rows[TIME]

    def _device(self, number: int) -> str:
        if number not in self._devices:
            topic = self._recording.topics.get(number)
            if topic is None:
                return ""
            self._devices[number] = self._device_of(topic)
        return self._devices[number]


def _records(block: MessageBlock, rows: Ints) -> tuple[bytes, Ints]:
    """Whole records of messages, and the end of each."""
    starts, ends = (rows[DATA] - _HEAD).tolist(), (rows[DATA] + rows[LENGTH]).tolist()
    sizes = rows[LENGTH] + _HEAD
    if ends and ends[-1] - starts[0] == int(sizes.sum()):  # they are consecutive
        return bytes(block.data[starts[0] : ends[-1]]), np.cumsum(sizes)
    return b"".join(block.data[start:end] for start, end in zip(starts, ends, strict=True)), np.cumsum(sizes)


def preamble(recording: McapReader, device_of: Callable[[MessageChannel], str], device: str) -> bytes:
    """Definitions of all channels of a device that are known so far."""
    return b"".join(definition(topic) for topic in recording.topics.values() if device_of(topic) == device)


def recorded_device(topic: MessageChannel) -> str:
    """The device of a channel in a recording of imuscope; "" if its messages are not those of a device."""
    return topic.metadata.get(DEVICE_KEY, "")
