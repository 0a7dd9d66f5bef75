"""Access to the operating system: files that are replaced whole, locks, limits, priorities of processes. Imports only
recordings/errors.py.
"""
