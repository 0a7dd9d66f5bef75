"""Text for others: printable characters, the format of Prometheus. Imports nothing else of the server."""
