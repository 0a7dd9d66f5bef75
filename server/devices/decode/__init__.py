"""Decoding of the bytes of a link: protocol, options, processor time. Begin with decode_pipeline.py. Imports device."""
