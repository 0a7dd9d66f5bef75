"""Uploads of recordings from a robot to the store. Begin with uploads.py. Imports model, store and robot."""
