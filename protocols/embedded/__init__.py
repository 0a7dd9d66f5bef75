"""Protocols that occur between the frames of others: NMEA 0183, UBX, RTCM, VectorNav. Begin with finders.py. Knows
framing and schema, no family.
"""
