"""Tables as text: lines, headings, cells, and the column that is their clock. Begin with table_source.py. Imports only
errors, system, file_names and sources of recordings.
"""
