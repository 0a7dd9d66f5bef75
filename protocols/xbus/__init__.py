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
    products.py   which MTi is which                 outputs.py  what can be sent, how often, what together
    commands.py   commands and settings per product  choices.py  flags, functions and lines of a product
    dialogues.py  the driver: read, write, restart   exchange.py states, requests, time-outs, retries
    changes.py    what a change does to the line     load.py     bytes a second, rates that fit
    spans.py      the bytes of a frame in words      identity.py what answers tell of the device
    device.py     the other end of the wire: a twin  settings.py, answers.py, measurement.py, sentences.py: its parts

Source: MT0101P revision 2020.A, with its errata.
"""
