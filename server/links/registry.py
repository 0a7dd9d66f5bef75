"""Registry of kinds of links.

Each file of `server/links/` that defines a kind registers it on import, and so does each module that another package
declares in the entry-point group `imuscope.links`. docs/add-a-link.md describes how to write one.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imuscope.protocols.family.plugins import Registry
from imuscope.server.links.base import Link, LinkSettings

if TYPE_CHECKING:
    from imuscope.server.links.source_url import SourceUrl

Examples = Iterable[tuple[str, str]]
"""Sources with descriptions for display."""


@dataclass(frozen=True, slots=True)
class LinkDefinition:
    """One kind of link.

    Args:
        name: unique: DeviceInfo.link and Link.kind ("tcp").
        title: displayed title.
        open: creates the link of a source, not connected yet, from the source as given, the settings, and the parsed
            source. An invalid source is a LinkError "bad-source".
        scheme: before the colon of a source; "" for the name.
        form: form of a source, for messages: "tcp://host:port".
        short_form: form in a list of all kinds, if different.
        usage: forms with their options and descriptions, for `--help`.
        examples: for the page.
        order: position in lists, ascending.
        shareable: its port can be held by another process and shared (server/extensions/shares/shared_port_link.py).
        counts_messages: of a link that receives messages: they are numbered, so that lost ones are known.
        network: bytes arrive over a network, which has varying delays and is reachable by others.
    """

    name: str
    title: str
    open: "Callable[[str, LinkSettings, SourceUrl], Link]"
    form: str
    scheme: str = ""
    short_form: str = ""
    usage: tuple[tuple[str, str], ...] = ()
    examples: Callable[[], Examples] = tuple
    order: int = 100
    network: bool = False
    shareable: bool = False
    counts_messages: bool = False


LINKS = Registry[LinkDefinition]("link", "imuscope.server.links", "imuscope.links")
register_link, load_links = LINKS.register, LINKS.load


def link_kinds() -> list[LinkDefinition]:
    """All kinds, sorted by `order`."""
    return list(LINKS.all().values())


def link_kind(name: str) -> LinkDefinition | None:
    return LINKS.all().get(name)


def link_schemes() -> Mapping[str, str]:
    """Scheme → name of every kind."""
    return {one.scheme or one.name: one.name for one in link_kinds()}


def is_network(name: str) -> bool:
    """Whether bytes of that kind of link arrive over a network."""
    one = link_kind(name)
    return one is not None and one.network


def source_forms() -> str:
    *most, last = [one.form for one in link_kinds()]
    return f"Sources look like {', '.join(most)} or {last}."
