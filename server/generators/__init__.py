"""Files that are generated from the server: TypeScript types, routes, references in docs/. Begin with files.py.
Imported by nothing.
"""
