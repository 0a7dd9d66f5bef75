"""A link and its devices: connection, recent bytes, who else reads it.

Begin with session.py. Imports decode and device.
"""
