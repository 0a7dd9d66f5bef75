"""Names of uploaded files, made safe: no folder, not hidden, with a suffix that the library lists."""

from __future__ import annotations

import os
import re
import unicodedata

from imuscope.recordings.file_suffixes import suffixes

LONGEST_NAME = 120
DEVICES = re.compile(r"(CON|PRN|AUX|NUL|COM\d|LPT\d)(\.|\Z)", re.I)  # reserved names on Windows


def clean_name(name: str) -> str:
    """A safe file name from any name: no folder, not hidden, printable, not a command-line option or a Windows
    device.

    >>> clean_name("../../etc/passwd\\x00")
    'passwd.bin'
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    text = "".join(c for c in last if c.isprintable() and c not in '<>:"|?*').rstrip(" .").lstrip(" .-")
    stem, suffix = os.path.splitext(text)
    if suffix.lower() not in suffixes():
        stem, suffix = text, ".bin"
    stem = stem.encode()[: LONGEST_NAME - len(suffix)].decode(errors="ignore").rstrip(" .").lstrip(" .-")
    if DEVICES.match(stem):
        stem = f"_{stem}"
    return f"{stem or 'upload'}{suffix}"
