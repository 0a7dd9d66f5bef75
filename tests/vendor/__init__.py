"""Comparison of the tables with the vendors' own headers."""
