"""Bytes ⇄ typed columns. No sockets, threads, sleeps, clocks or asyncio; knows nobody else in the house."""
