"""Counters and clocks of devices: unwrapped ticks, gaps in sequences, device time against host time. Begin with
clock_sync.py; clock_model.py has the estimate. Knows events and native, no family.
"""
