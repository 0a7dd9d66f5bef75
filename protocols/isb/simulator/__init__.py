"""Simulated IMX, GPX and EVB."""
