"""A link and its devices: connection, recent bytes, other readers. Begin with session.py. Imports decode and device."""
