"""Helpers that tests import: servers and links to feed, clocks to turn, waits without limits of the machine."""
