"""The protocols for a session: the rows of protocols/registry/families.py."""

from collections.abc import Container

from imuscope.protocols.events import Decoder
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.messages.family import MESSAGES
from imuscope.protocols.registry.families import PROBLEMS, PROTOCOLS, count_messages, counts_losses, detect, family_of
from imuscope.recordings.readers.registry import READERS
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.device.ingest import ProtocolTraits
from imuscope.server.links.registry import link_kind, load_links
from imuscope.server.wire import DeviceInfo


def protocols() -> dict[str, str]:
    """Name → title of every protocol."""
    return {name: info.title for name, info in PROTOCOLS.items()}


def sensors_of(protocol: str, product: str) -> SensorProperties:
    """Axes and noise of the sensors of a product, as its family declares them."""
    row = PROTOCOLS.get(protocol)
    return row.device.sensors(product) if row is not None else SensorProperties()


def device_counts_losses(device: DeviceInfo, channels: Container[str]) -> bool:
    """Whether lost samples of a device are counted: none lost then means that none are missing.

    Args:
        channels: names of what it sends.
    """
    if device.protocol == MESSAGES.name:
        kind = link_kind(device.link)
        return kind is not None and kind.counts_messages
    return counts_losses(device.protocol, channels)


def problems() -> list[str]:
    """A sentence for each family, exporter, reader and link of another package that cannot be used."""
    from imuscope.recordings.exporters import PROBLEMS as OF_EXPORTERS

    return [*PROBLEMS, *OF_EXPORTERS, *READERS.problems(), *load_links()]


def all_protocols() -> ProtocolSet:
    def decoder(name: str, reading: DecodeOptions, link_kind: str) -> Decoder:
        row = _family(name)
        datagrams = {"datagrams": True} if row.stream.datagrams and link_kind == "udp" else {}
        silence = {"arrivals": False} if row.stream.silence and link_kind == "file" else {}
        return row.decoding.decoder(**reading.settings(name), **datagrams, **silence)

    def about(name: str) -> ProtocolTraits:
        row = _family(name)
        return ProtocolTraits(
            stream=row.stream,
            device=row.device,
            protection=row.decoding.protection,
            frame_size=row.frames.frame_size,
            configuration_frames=row.frames.configuration_frames,
        )

    def title(name: str) -> str:
        family = family_of(name)
        return family.title if family is not None else name

    return ProtocolSet(decoder=decoder, guess=detect, title=title, about=about, count_messages=count_messages)


def _family(name: str) -> ProtocolInfo:
    """The family of that name; KeyError if unknown."""
    family = family_of(name)
    if family is None:
        raise KeyError(name)
    return family
