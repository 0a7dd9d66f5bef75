"""MicroStrain MIP as a protocol family of imuscope.

packets.py     frames: find, check, build
messages.py    fields of data, replies and commands, as rows
json_codec.py  one packet as values and back
decoder.py     columns and replies; the listing of `imuscope inspect`; detection
driver.py      commands, settings, transactions
simulator.py   the other end of the wire
family.py      all of it as one object
"""
