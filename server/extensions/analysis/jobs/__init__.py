"""Analyses that run in processes of their own, their routes and commands. Begin with jobs.py. May import all rooms of
analysis.
"""
