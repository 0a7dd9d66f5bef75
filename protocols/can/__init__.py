"""Messages of inertial sensors on a CAN bus.

definition.py   identifiers of a device → its messages, as a line of the stream
lines.py        lines of a log of CAN frames
rows.py         what a message is: its identifier, bytes and quantities
mti.py          the messages of an MTi
survey.py       which identifiers of a log are those of a device
decoder.py      lines in, sample groups out
"""
