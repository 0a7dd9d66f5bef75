"""Readers, one in each file, registered when it is imported; and what several of them share (flight_log, …)."""
