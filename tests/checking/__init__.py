"""What tests/check.py is made of: the state of the machine, what a change touches, where the time goes."""
