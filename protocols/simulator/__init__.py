"""What the simulators of all families share."""
