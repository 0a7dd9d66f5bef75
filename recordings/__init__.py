"""Chunks on disk: decoded columns, replay, import and export. Knows protocols, nobody else in the house."""
