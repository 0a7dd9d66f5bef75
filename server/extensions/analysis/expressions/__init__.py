"""Channels derived by formulas, live and recorded. Begin with expressions.py. Imports signals and noise."""
