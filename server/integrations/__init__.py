"""Third-party viewers, fed from the bus or from recordings, behind our own port.

The server does not import them: each runs in a subprocess, or is a page of files. So the server starts fast (viser
takes seconds to import), their errors do not affect the devices, and unused ones cost nothing.
"""
