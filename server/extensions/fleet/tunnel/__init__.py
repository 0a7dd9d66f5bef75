"""Requests of a page through the connection that a robot keeps. Begin with http_tunnel_protocol.py. Imports model."""
