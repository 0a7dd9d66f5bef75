"""Noise of a sensor: Allan deviation, spectra, disturbances, preconditions of a figure, comparison with a data sheet.
Begin with allan_deviation.py. Imports signals.
"""
