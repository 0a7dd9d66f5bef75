"""Readers of files that imuscope did not write; see registry.py."""
