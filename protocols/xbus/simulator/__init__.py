"""Simulated MTi: the other end of the wire."""
