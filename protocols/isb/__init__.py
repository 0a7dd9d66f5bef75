"""Inertial Sense IMX, GPX and EVB: the ISB binary protocol 2.x.

    from protocols.isb.decoder import IsbDecoder

    decoder = IsbDecoder()
    decoder.feed(chunk, arrival_ns)
    for event in decoder.drain():       # Batch, Reply, Text, Reject, Step (protocols/events.py)
        ...

    datasets.txt  every data set, field, flag and version, as data     tables.py    read into rows
    messages.py   which fields a payload of some size has              frames.py    scan and build packets
    sorting.py    which packets share columns, and when they were      timeline.py  the device's clocks
    decoder.py    columns, replies, time                               plain.py     one packet as values and back
    listing.py    a capture line by line                               likeness.py  do bytes look like it?

Source: Inertial Sense binary protocol document; inertial-sense-sdk 2.7.1.
"""
