"""The MCAP file format: records, reader, writer, compaction, and what imuscope writes into it. Begin with writer.py,
which describes a recording. Imports only system, errors, file_names and sources of recordings.
"""
