"""Errors that a user can do something about: a failing disk, a file of a later version."""

import errno
from collections.abc import Iterable
from pathlib import Path

READABLE = "Is it there, and may this server read it?"
_FREE = "Free some space, or delete recordings; the recording so far is kept."
FULL = (errno.ENOSPC, errno.EDQUOT)
_HINTS = {
    errno.ENOSPC: _FREE,
    errno.EDQUOT: _FREE,
    errno.EFBIG: "Raise the limit (`ulimit -f`), or split recordings earlier (`split_mb`); what there is is kept.",
    errno.EACCES: "Give the user that runs imuscope write permission there, or choose another folder with --data.",
    errno.EROFS: "Choose another folder with --data.",
    errno.ENOENT: "Was the folder removed? Choose another with --data.",
    errno.EEXIST: "Choose another name.",
    errno.EIO: "The disk or its cable is failing: copy its data elsewhere, then look at the system's log (dmesg).",
}
_WORDS = {
    errno.ENOSPC: "The disk is full",
    errno.EDQUOT: "The disk quota is used up",
    errno.EFBIG: "The file has reached the largest size that the system allows",
    errno.EEXIST: "There is a file of that name already",
    errno.EIO: "The disk failed (input/output error)",
}


def near_miss(name: str, known: Iterable[str]) -> str:
    """Question for the most similar name, to be put after it; "" without one."""
    from difflib import get_close_matches

    by_case = {one.casefold(): one for one in known}
    near = get_close_matches(name.casefold(), by_case, 1)
    return f" (did you mean {by_case[near[0]]!r}?)" if near else ""


class ExplainedError(Exception):
    """A failure: one sentence, and what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint

    @property
    def text(self) -> str:
        """The sentence and what to do, for a line of text."""
        return f"{self.message} {self.hint}".strip()


class RecordingError(ExplainedError):
    """External failure (full disk, missing folder): one sentence, and what to do.

    Args:
        is_full: the disk, or the quota on it, is used up, which passes.
    """

    def __init__(self, message: str, hint: str = "", *, is_full: bool = False) -> None:
        super().__init__(message, hint)
        self.is_full = is_full


def check_format_version(name: str, version: object, known: int) -> RecordingError | None:
    """Error for a file of a later format; None if it can be read.

    Args:
        known: the latest that this version reads.
        version: as found in the file, of any type; an absent or invalid one counts as the first.
    """
    text = str(version)
    if isinstance(version, bool) or not (text.isascii() and text.isdigit()) or int(text[:9]) <= known:
        return None
    words = f"{name} was written by a newer imuscope (format {text[:9]}; this one reads {known})."
    return RecordingError(words, "Update imuscope; the file is left as it is.")


def disk_error(error: OSError, path: Path) -> RecordingError:
    """Error text for a failing disk."""
    cause = _WORDS.get(error.errno or 0, (error.strerror or "It cannot be written").capitalize())
    return RecordingError(f"{cause}: {path.name}.", _HINTS.get(error.errno or 0, ""), is_full=error.errno in FULL)
