"""The operating system: worker processes, signals, open files, terminals. Begin with workers.py, the only file that
starts processes. Imports nothing of the server but errors.
"""
