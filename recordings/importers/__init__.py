"""Recognition and opening of a file of any format. Begin with open_file.py. May import readers, tables and mcap; of
recordings, only library and exporters import it.
"""
