"""Tasks, listeners, queues, limits and pauses for the event loop. Imports nothing else of the server."""
