"""Parts of tests/check.py: the state of the machine, what a change touches, where the time goes."""
