"""Recordings of many robots in one store."""
