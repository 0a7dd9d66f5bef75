"""Rules for uploads: which finished recordings go to the store, and when
(server/extensions/fleet/model/store_settings.py).

The reason for refusing a recording is a text. The rules are evaluated at each check, so a tag that is added later
counts.
"""

from __future__ import annotations

from datetime import datetime

from imuscope.recordings.library.entry import LibraryEntry
from imuscope.server.extensions.fleet.model.store_settings import StoreSettings, hours_of

ALARM_TITLE, ALARM_MARKER = "Alarm ", "Alarm “"  # as server/extensions/alarms/recording_trigger.py writes them


def refusal(entry: LibraryEntry, settings: StoreSettings) -> str:
    """Reason against an upload, one sentence; "" if there is none."""
    tags = {tag.casefold() for tag in entry.edits.tags or ()}
    if matches := [tag for tag in settings.skip_tags if tag.casefold() in tags]:
        return f"It has the tag {matches[0]}."
    if settings.upload_tags and not tags & {tag.casefold() for tag in settings.upload_tags}:
        return f"It has none of the tags {', '.join(settings.upload_tags)}."
    duration = entry.probe.duration
    if duration is not None and duration < settings.upload_min_s:
        return f"It is shorter than {settings.upload_min_s:g} s."
    if settings.upload_max_mb and entry.size > settings.upload_max_mb * 1e6:
        return f"It is larger than {settings.upload_max_mb:g} MB."
    if settings.upload_alarms_only and not _is_of_alarm(entry):
        return "No alarm has begun or marked it."
    return ""


def pause_until(settings: StoreSettings, now: datetime) -> str:
    """Time of day until which uploads wait, "22:00"; "" if they need not."""
    hours = hours_of(settings.upload_hours)
    if hours is None:
        return ""
    begin, end = hours
    minute = now.hour * 60 + now.minute
    is_within = begin <= minute < end if begin < end else minute >= begin or minute < end
    return "" if is_within else f"{begin // 60:02}:{begin % 60:02}"


def _is_of_alarm(entry: LibraryEntry) -> bool:
    return entry.probe.title.startswith(ALARM_TITLE) or any(
        text.startswith(ALARM_MARKER) for text in entry.marker_texts
    )
