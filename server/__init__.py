"""The server: links, device sessions, streaming, recordings and the HTTP API. The only package that uses asyncio and
FastAPI.
"""
