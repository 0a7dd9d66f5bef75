"""One device: its name, its state, its samples on the way to channels, its figures and events. Begin with ingest.py.
Imports neither decode nor link.
"""
