"""The search for the clock of a table: readings of each column as a time, and the choice between them. Begin with
search.py. Imports no other part of recordings but tables.
"""
