"""Signals as an analysis sees them: times, values, units, axes of a triad, rest. Begin with signals.py. Imports no
other room of analysis.
"""
