"""Simulated IMX, GPX and EVB: the other end of the wire."""
