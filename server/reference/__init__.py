"""Reference pages made from the program itself: HTTP API, WebSocket, supported devices.

OpenAPI, server/wire/, tables ─> blocks ─┬─> HTML at /docs (server/api/reference.py)
                                           └─> docs/*.md (python -m imuscope.server.generators.docs)
"""
