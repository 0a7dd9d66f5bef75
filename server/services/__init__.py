"""Long-lived objects of a server, and the doors through which extensions add theirs. Begin with services.py. Imports
everything but api, app and commands.
"""
