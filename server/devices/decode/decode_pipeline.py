"""Decode pipeline of one link: protocol detection, then decoding to its devices' samples, a slice at a time.

    chunk ──put──> stored, while the protocol is unknown ──decode──> detected ──> begin(protocol), fed all stored chunks
                └> LinkDecoder (server/devices/device/device_demux.py) ──decode──> sink

Each connection has a new decoder and a new clock mapping (`disconnect`, `begin`); channels, counts and the last
sequence numbers of Secure devices continue.
"""

from collections.abc import Callable, Sequence

from imuscope.protocols.events import Batch, Doubts, Event, Remarks, Reply
from imuscope.server.devices.decode.decode_budget import Slices
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_detection import ProtocolDetector, ProtocolSet, unknown_hint
from imuscope.server.devices.decode.sequence_restarts import Restarts
from imuscope.server.devices.device.device_demux import LinkDecoder, LinkDevices
from imuscope.server.devices.device.device_state import short_source
from imuscope.server.devices.device.ingest import LinkTiming
from imuscope.server.links.base import CHUNK_COST, Chunk, Link
from imuscope.server.streaming.sink import TelemetrySink


class DecodePipeline:
    """Decode pipeline of one session.

    Args:
        link: source of the chunks; its flow limits how much is read at once.
        devices: the devices on it.
        protocol_set: the protocols.
        options: decode options; without a protocol it is detected.
        on_events: called with all decoded events, after the sink has them.
        on_restart: called before a file that is played again gets a new decoder.

    Attributes:
        stream: of this connection; None while the protocol is unknown.
        decoder: of this connection or the last one; None before the first.
        doubting: the same, if its protocol has an option that a stream can contradict.
        detector: stores chunks while the protocol is unknown.
        slices: how much is decoded at once.
    """

    def __init__(
        self,
        link: Link,
        sink: TelemetrySink,
        devices: LinkDevices,
        protocol_set: ProtocolSet,
        options: DecodeOptions,
        restarts: Restarts,
        *,
        on_events: Callable[[Sequence[Event]], None],
        on_restart: Callable[[], None],
    ) -> None:
        self._link, self._sink, self._devices, self._protocols = link, sink, devices, protocol_set
        self._state = devices.own.state
        self._restarts = restarts
        self._on_events, self._on_restart = on_events, on_restart
        self.options = options
        self.stream: LinkDecoder | None = None
        self.decoder: object = None
        self.doubting: Doubts | None = None
        self.detector = ProtocolDetector(protocol_set.guess)
        self.slices = Slices()
        link.flow.at_once = self.slices.size
        self._dirty = False  # there is something to decode or to detect

    @property
    def samples(self) -> int:
        """Samples of the link's own device since it was last silent."""
        return self.stream.samples if self.stream is not None else 0

    @property
    def known_protocol(self) -> str:
        """The protocol, as the link determines or the user gave it; "" to detect it."""
        return self._link.protocol or self.options.protocol

    @property
    def notices(self) -> list[str]:
        """Remarks of the link, and of the decoder on its stream."""
        return [*self._link.notices, *(self.decoder.remarks if isinstance(self.decoder, Remarks) else ())]

    def use_link(self, link: Link) -> None:
        """Decode the bytes of another link from now on."""
        self._link = link

    def disconnect(self) -> None:
        """Reset for the next bytes: on another connection, or with other options."""
        self.stream = None
        self.detector = ProtocolDetector(self._protocols.guess)

    def begin(self, protocol: str) -> None:
        """Start decoding with a known protocol, stored bytes first."""
        options = self.options
        decoder = self.decoder = self._protocols.decoder(protocol, options, self._link.kind)
        self.doubting = decoder if isinstance(decoder, Doubts) else None  # slow, so not in every turn
        about = self._protocols.about(protocol)
        self._restarts.begin(decoder)
        self._link.flow.keep_datagrams = about.stream.datagrams
        self._link.use_frames(about.frame_size, about.configuration_frames)
        line = LinkTiming.of(self._link)
        self.stream = LinkDecoder(self._sink, self._devices, decoder, line=line, about=about, on_events=self._on_events)
        name = self._state.name(self._state.info.product, protocol)
        self._state.set(protocol=protocol, name=name, decode_options=options.shown)
        for chunk in self.detector.take():
            self._feed(chunk)

    def set_option(self, name: str, value: str) -> None:
        """Decode with another value of an option, with a new decoder."""
        self.options = self.options.replaced({name: value})
        self.begin(self._state.info.protocol)

    def put_all(self, chunks: Sequence[Chunk]) -> None:
        """Append chunks; cheap, as there are thousands a second."""
        size = CHUNK_COST * len(chunks)
        for chunk in chunks:
            size += len(chunk.data)
        self.slices.add(size)
        self._dirty = True
        if self.stream is None:
            for chunk in chunks:
                self.detector.add(chunk)
        elif any(chunk.restart for chunk in chunks):
            for chunk in chunks:
                self._feed(chunk)
        else:
            self.stream.feed_all(chunks)

    def _feed(self, chunk: Chunk) -> None:
        """Feed a chunk to the decoder; if a file starts again with it, to a new one.

        The previous decoder would take the jump back for a reset, a clock jump or a loss.
        """
        if chunk.restart:
            self._on_restart()
            self.begin(self._state.info.protocol)
            words = f"{short_source(self._state.info.source)} starts again."
            self._devices.own.events.report_restart(words, chunk.arrival_ns / 1e9)
        assert self.stream is not None
        self.stream.feed(chunk)

    def mark_dirty(self) -> None:
        """Let the next turn process the stored bytes even if no more arrive."""
        self._dirty = True

    @property
    def is_due(self) -> bool:
        """Whether there is something to decode or to detect."""
        return self._dirty

    def end_slice(self) -> None:
        """End the slice; the size of the next one follows from the time it took."""
        self.slices.end()
        self._link.flow.at_once = self.slices.size

    def decode(self, *, final: bool) -> None:
        """Decode the queued bytes. `final`: no more will arrive on this connection."""
        self._dirty = False
        if self.stream is None:
            self._detect(final=final)
        if self.stream is not None:
            self.stream.drain(stalled=final)

    def hides_messages(self) -> bool:
        """Whether whole messages wait behind the beginning of an incomplete message, which may be a false start.

        A frame of which the rest comes late is a good frame: the bytes waiting for it prove nothing.
        """
        if self.stream is None:
            return False
        waiting = self.stream.undecided()
        if len(waiting) < self.stream.buffered:
            return True  # more than is stored, and more than any frame has
        trial = self._protocols.decoder(self._state.info.protocol, self.options, self._link.kind)
        trial.feed(waiting, 0)
        return any(isinstance(event, (Batch, Reply)) for event in trial.drain(stalled=True))

    def _detect(self, *, final: bool) -> None:
        """Detect the protocol from the stored bytes."""
        if not self.detector:
            return
        now = self._sink.now()
        if not self.detector.is_due(now, final=final):
            self._dirty = True  # look again when the time is over
            return
        guess, why = self.detector.detect(now)
        source = self._state.info.source
        if guess is not None:
            self._devices.own.events.report("device", "info", f"{source}: {why}")
            self.begin(guess.protocol)
            return
        self._state.set(message=self.detector.words(source, why), hint=unknown_hint(self._link.kind))

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of this connection from an offset of the decoder; b"" if they are no longer stored."""
        return self.stream.bytes_at(offset, size) if self.stream is not None else b""
