"""List of the capabilities of this server, collected from the registries: protocols, export formats, kinds of links."""

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.exporters import FORMATS
from imuscope.recordings.optional_packages import lacks
from imuscope.server.links.registry import link_kinds
from imuscope.server.wire.capabilities import (
    Capabilities,
    DecodeOptionChoice,
    DecodeOptionInput,
    ExportCapability,
    LinkCapability,
    PayloadNumber,
    ProtocolCapability,
    SourceExample,
)


def list_capabilities() -> Capabilities:
    """Everything that is registered, in the order in which the page offers it."""
    return Capabilities(
        protocols=[_protocol(family) for family in PROTOCOLS.values()],
        exports=[
            ExportCapability(
                name=name,
                title=one.label or one.title,
                words=one.words,
                suffix=one.suffix,
                single=one.needs_source,
                protocol=one.protocol,
                takes_units=one.takes_units,
                per_byte=one.per_byte,
            )
            for name, one in FORMATS.items()
            if not lacks(*one.modules)
        ],
        links=[
            LinkCapability(
                one.name,
                one.title,
                [SourceExample(source, words) for source, words in one.examples()],
                one.shareable,
                one.counts_messages,
            )
            for one in link_kinds()
        ],
    )


def _choices(option: DecodeOption) -> tuple[tuple[str, str], ...]:
    return ((("", option.unset),) if option.unset else ()) + option.choices


def _protocol(family: ProtocolInfo) -> ProtocolCapability:
    payload = family.decoding.payload_definition
    return ProtocolCapability(
        name=family.name,
        title=family.title,
        short=family.short_title,
        simulator=family.simulator is not None,
        options=[
            DecodeOptionInput(
                name=option.name,
                title=option.title,
                kind=option.kind,
                choices=[DecodeOptionChoice(value, words) for value, words in _choices(option)],
                default=option.default,
                early=option.early,
                pattern=option.pattern,
                malformed=option.malformed,
                example=option.example,
            )
            for option in family.decoding.options
            if option.title
        ],
        payload_option=payload.option if payload else "",
        payload_template=payload.template if payload else "",
        payload_numbers=[PayloadNumber(name, size) for name, size in payload.types] if payload else [],
        attitude_hint=family.page.hints.attitude,
        identify_hint=family.page.hints.identify,
        pause_hint=family.page.hints.pause,
        abbreviations=list(family.page.abbreviations),
        plots=list(family.page.panels.plots),
        panels=list(family.page.panels.panels),
        counts_losses=family.stream.counts,
        counter=family.stream.counter,
    )
