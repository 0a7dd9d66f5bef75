"""Changes of settings of many robots, step by step. Begin with rollouts.py. Imports model and tunnel."""
