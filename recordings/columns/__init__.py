"""Decoded samples as columns on disk: store, statistics, envelopes for plots, health over time. Begin with store.py.
Imports only system and errors of recordings.
"""
