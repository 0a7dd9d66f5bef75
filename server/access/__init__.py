"""Access control: tokens, routes that a view token may use, limits of requests and logins, headers. Begin with auth.py.
Imports settings and what stands above them.
"""
