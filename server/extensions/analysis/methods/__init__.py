"""Analyses that come with imuscope, one file each."""
