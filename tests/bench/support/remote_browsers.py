"""Browsers on other machines, for the benchmarks.

python tests/bench/support/remote_browsers.py URL N      reads everything as N clients, until it is ended
"""

from __future__ import annotations

import asyncio
import sys

from tests.support.load_clients import Good


async def main() -> None:
    """The command line."""
    await asyncio.gather(*(Good().run(sys.argv[1]) for _ in range(int(sys.argv[2]))))


if __name__ == "__main__":
    asyncio.run(main())
