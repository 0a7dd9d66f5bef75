"""Recordings: taken, kept, opened, and handed on."""
