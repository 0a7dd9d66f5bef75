"""Rules for deleting uploaded recordings: which one of the library may go to the bin next.

Only a recording made by imuscope (MCAP) that the store has with all its words: one that was edited after its upload, is
pinned, has one of `keep_tags`, or is played as a device, stays. uploads.py has the store confirm it before it goes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from imuscope.recordings import sidecar
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.server.extensions.fleet.model.store_settings import StoreSettings
from imuscope.server.extensions.fleet.upload.upload_log import UploadOutcome

DAY_S = 86_400.0


def edits_of(entry: LibraryEntry) -> int:
    """Time of change of a recording's sidecar, ns; 0 if it has none."""
    try:
        return sidecar.sidecar_path(entry.path).stat().st_mtime_ns
    except OSError:
        return 0


def next_to_go(
    entries: Collection[LibraryEntry],
    outcome_of: Callable[[LibraryEntry], UploadOutcome | None],
    settings: StoreSettings,
    now: float,
    played: Collection[str] = (),
) -> LibraryEntry | None:
    """The oldest recording that the rules allow to delete; None if there is none. It reads sidecars: call it in a
    thread.

    Args:
        played: sources of devices; a recording that is one of them stays.
    """
    excess = sum(entry.size for entry in entries) - settings.keep_gb * 1e9 if settings.keep_gb else 0.0
    protected_tags = {tag.casefold() for tag in settings.keep_tags}
    for entry in sorted(entries, key=lambda one: one.began):
        outcome = outcome_of(entry)
        if outcome is None or outcome.state != "stored":
            continue
        is_old = settings.keep_days > 0 and now - outcome.time >= settings.keep_days * DAY_S
        if not is_old and excess <= 0:
            continue
        is_ours = entry.probe.format == "mcap" and len(entry.files) == 1
        has_tag = bool(protected_tags & {tag.casefold() for tag in entry.edits.tags or ()})
        is_played = any(source.partition("?")[0] == str(entry.path) for source in played)
        if not is_ours or has_tag or is_played or entry.edits.pinned or edits_of(entry) != outcome.edits:
            continue
        return entry
    return None
