"""Installations: source distribution, wheels, container, 64-bit ARM, and one without what is optional."""
