"""Decoding of the bytes of a link: protocol, options, share of the processor.

Begin with decode_pipeline.py. Imports device.
"""
