"""Third-party host programs against imuscope's simulators: see run.py. Not part of the regular tests."""
