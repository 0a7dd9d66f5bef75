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

    commands.py   what it can be told and keeps, as rows               manual.py    ranges and meanings of fields
    writing.py    the bytes of a command or a setting                  spans.py     what each byte of them is
    dialogues.py  the driver: ask, tell, read back                     listening.py what streams, and how often
    streams.py    what can stream                                      load.py      what that costs the line
    compare.py    do two values mean the same?                         line.py      would it cut the line?
    device.py     the twin                                             memory.py, speech.py, measurement.py  its parts

Source: Inertial Sense binary protocol document; inertial-sense-sdk 2.7.1.
"""
