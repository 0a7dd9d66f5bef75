"""Where bytes, clocks and people meet: links in, a decoder in the middle, browsers out. Only here: asyncio, FastAPI."""
