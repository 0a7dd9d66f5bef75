"""Declarations of a family of protocols about itself, and the search for families among the installed packages. Begin
with info.py. Knows all of protocols but the families and their registry.
"""
