"""Analyses of signals, live and recorded alike: pure functions over columns (`methods/`), found by a registry."""
