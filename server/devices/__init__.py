"""Devices as they are now: links' bytes become channels, events and figures, and wait for the browsers."""
