"""Readers, one in each file; each is registered when it is imported."""
