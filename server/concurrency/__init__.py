"""Tasks, listeners, queues, limits and pauses that the event loop needs everywhere.

Imports nothing else of the server.
"""
