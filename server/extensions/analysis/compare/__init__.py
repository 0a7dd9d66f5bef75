"""Comparison of two sides: time offset, rotation between them, differences. Begin with comparison.py. Imports signals
and expressions.
"""
