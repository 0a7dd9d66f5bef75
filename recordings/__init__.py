"""Chunks on disk: decoded columns, replay, import and export. Imports protocols, no other part of the project."""
