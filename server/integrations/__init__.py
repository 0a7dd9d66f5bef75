"""Other people's viewers, fed from the hub or from recordings, behind our own port.

Nothing of theirs is imported by the server: each runs in a process of its own, or is a page of files. That keeps the
start fast (viser takes seconds to import), keeps a fault of theirs away from the devices, and costs nothing unused.
"""
