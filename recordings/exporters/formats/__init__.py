"""Export formats, one file each. A file registers its format as it is imported (recordings/exporters/registry.py)."""
