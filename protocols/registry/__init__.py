"""All families that are installed, detection of the family of some bytes, and lines that several of them share. Begin
with families.py. May import everything in protocols.
"""
