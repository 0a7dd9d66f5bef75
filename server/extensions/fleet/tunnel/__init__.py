"""HTTP requests of a page through the connection that a robot keeps open.

Begin with http_tunnel_protocol.py. Imports model.
"""
