"""Settings of a server, from its file and its command line, with their types and ranges. Begin with config.py. Imported
by nearly everything; imports devices and what stands above them.
"""
