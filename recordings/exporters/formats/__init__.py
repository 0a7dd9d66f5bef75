"""Export formats. A file registers its formats as it is imported (recordings/exporters/registry.py)."""
