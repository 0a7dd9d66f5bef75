"""Other people's host programs against imuscope's simulators: see run.py. Not part of the tests that everybody runs."""
