"""From bytes to frames: buffer, scan for preambles, checksums, frames grouped into batches. Begin with
stream_buffer.py. Knows schema and events, no family.
"""
