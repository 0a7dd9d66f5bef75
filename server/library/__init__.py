"""Recordings: record, store, open and export."""
