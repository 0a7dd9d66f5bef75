"""Settings of the store of recordings: the table `[store]` of the configuration file, and `--store`.

    [store]
    url = "s3://bucket/prefix"  # or a folder
    query_s = 60                # limits of a question over HTTP
    query_mb = 1024

Credentials come from the environment (server/fleet/store.py).
"""

from __future__ import annotations

from dataclasses import dataclass

MIN_QUERY_MB, MAX_QUERY_MB = 64, 1 << 24


@dataclass(frozen=True, slots=True)
class StoreSettings:
    """A store.

    Args:
        url: URL or path; "" for none.
        query_s, query_mb: longest time and most memory of a question over HTTP.
    """

    url: str = ""
    query_s: float = 60.0
    query_mb: int = 1024
