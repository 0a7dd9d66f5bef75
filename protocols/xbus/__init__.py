"""Xsens MTi: the Xbus protocol (MT low-level communication protocol).

    from protocols.xbus.decoder import XbusDecoder

    decoder = XbusDecoder()
    decoder.feed(chunk, arrival_ns)
    for event in decoder.drain():       # Batch, Reply, Text, Reject, Gap, Step (protocols/events.py)
        ...

    messages.py   every message, as a table          items.py    every MTData2 data identifier
    codes.py      enumerations and flag words        frames.py   scan and build frames, walk items
    stream.py     frames, sentences, rejects         decoder.py  columns, replies, time, loss
    plain.py      one frame as plain values and back strings.py  the two binary strings
    device.py     the other end of the wire          identity.py what answers tell of the device

Source: MT0101P revision 2020.A, with its errata.
"""
