"""Bytes ⇄ typed columns. No sockets, threads, sleeps, clocks or asyncio; imports no other part of the project."""
