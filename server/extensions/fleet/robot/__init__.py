"""Membership of a robot: its reports, its settings, findings for its own doctor. Begin with publisher.py. Imports model
and store.
"""
