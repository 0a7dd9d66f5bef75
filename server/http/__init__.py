"""The HTTP server below the application: TLS, connections, handshakes, shutdown, files of the page. Begin with
server.py. Knows settings, no route.
"""
