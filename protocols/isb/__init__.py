"""Inertial Sense IMX, GPX and EVB: the ISB binary protocol 2.x.

    from imuscope.protocols.isb.decoder import IsbDecoder

    decoder = IsbDecoder()
    decoder.feed(chunk, arrival_ns)
    for event in decoder.drain():       # Batch, Reply, Text, RejectedFrame, ClockStep (protocols/events.py)
        ...

    sentences.py         sentences of NMEA 0183 that only these devices send
    datasets.txt         every data set, field, flag and version, as data
    dataset_loader.py    datasets.txt as rows
    messages.py          the fields of a payload by its size
    frames.py            scan and build packets
    classify.py          packets grouped by layout, and their times
    time_base.py         the clocks of the device
    decoder.py           columns, replies, time
    json_codec.py        one packet as values and back
    inspect.py           a capture line by line, and its score for this protocol
    commands.py          commands and settings, as rows
    field_docs.py        ranges and meanings of fields
    encoder.py           the bytes of a command or a setting
    annotate.py          the bytes of a packet in words
    driver.py            read, write, read back
    stream_discovery.py  which data sets stream, and how often
    streams.py           data sets that can stream
    bandwidth.py         bytes a second of streams
    config_effects.py    risks of a change: what would cut the line, side effects
    simulator/           simulated devices

Source: Inertial Sense binary protocol document; inertial-sense-sdk 2.7.1.
"""

from imuscope.protocols.embedded.nmea import add_sentences
from imuscope.protocols.isb import sentences
from imuscope.protocols.schema.labels import add_acronyms

add_sentences(sentences.ROWS, sentences.PAIRS)
add_acronyms("GPX", "IMX")
