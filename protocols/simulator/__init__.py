"""Common parts of the simulators of all families."""
