"""Records that robots, fleet servers and pages exchange: reports, settings, keys, journals, access. Imports no other
room of the fleet.
"""
