"""Ports that are shared with the robot's own programs: the server side, and the process that holds a port (holder/).

entry.py declares the extension, apart from this file: the holder imports this one, and nothing heavy.
"""
