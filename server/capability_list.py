"""List of the capabilities of this server, collected from the registries: protocols, export formats, kinds of links."""

from __future__ import annotations

from protocols.family import ProtocolInfo
from protocols.registry import PROTOCOLS
from recordings.exporters import FORMATS
from server.capabilities import (
    Capabilities,
    DecodeOptionChoice,
    DecodeOptionInput,
    ExportCapability,
    LinkCapability,
    ProtocolCapability,
    SourceExample,
)
from server.links.registry import link_kinds


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
                per_byte=one.per_byte,
            )
            for name, one in FORMATS.items()
        ],
        links=[
            LinkCapability(one.name, one.title, [SourceExample(source, words) for source, words in one.examples()])
            for one in link_kinds()
        ],
    )


def _protocol(family: ProtocolInfo) -> ProtocolCapability:
    return ProtocolCapability(
        name=family.name,
        title=family.title,
        short=family.short_title,
        simulator=family.simulator is not None,
        options=[
            DecodeOptionInput(
                name=form.name,
                title=form.title,
                choices=[DecodeOptionChoice(value, words) for value, words in form.choices],
                default=form.default,
                early=form.early,
            )
            for form in family.option_forms
        ],
        describes_payloads=family.parse_schema is not None,
        attitude_hint=family.hints.attitude,
        identify_hint=family.hints.identify,
        pause_hint=family.hints.pause,
        abbreviations=list(family.abbreviations),
        plots=list(family.panels.plots),
        panels=list(family.panels.panels),
    )
