"""Browsers on other machines, for the benchmarks.

python tests/bench/remote_browsers.py URL N      reads everything as N clients, until it is ended
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.bench.fanout import FanoutReader, client


async def main() -> None:
    """The command line."""
    await asyncio.gather(*(client(sys.argv[1], FanoutReader()) for _ in range(int(sys.argv[2]))))


if __name__ == "__main__":
    asyncio.run(main())
