"""`imuscope compact --store URL`: join the small files of a store."""

from __future__ import annotations

from typing import TextIO

from imuscope.protocols.plural import counted
from imuscope.server.extensions.fleet.store import MISSING, PACKAGES, StoreError, location


class CompactError(Exception):
    """An error that the user can correct, in one line."""


def compact_store(url: str, remove: bool, out: TextIO) -> None:
    """Join the files of a store, and write a line for each table.

    Args:
        url: URL or path of the store.
        remove: whether files that nothing needs any more are removed.

    Raises:
        CompactError: the store cannot be used.
    """
    try:
        from imuscope.server.extensions.fleet.compact import compact
    except ModuleNotFoundError as error:
        if error.name not in PACKAGES:
            raise
        raise CompactError(MISSING) from None
    try:
        for one in compact(location(url), remove=remove):
            words = f"{counted(one.joined, 'file')} joined into {one.into}" if one.joined else "nothing to join"
            more = f", {counted(one.removed, 'file')} removed" if remove else ""
            out.write(f"{one.name}: {words}{more}\n")
            out.flush()
    except StoreError as error:
        raise CompactError(f"{error.message.rstrip('.')}. {error.hint}".strip()) from None
