"""Kernels: functions over bytes and integers that run as machine code, or as plain Python without it. Begin with
kernels.py; compiler/ translates them when a package is built. Imports nothing else of protocols.
"""
