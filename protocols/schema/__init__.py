"""Messages as data: fields with types, units and choices; layouts, validation and display derive from them. Begin with
fields.py. Imports only arrays, native and rotations of protocols.
"""
