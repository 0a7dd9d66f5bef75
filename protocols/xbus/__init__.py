"""Xsens MTi: the Xbus protocol (MT low-level communication protocol).

    from imuscope.protocols.xbus.decoder import XbusDecoder

    decoder = XbusDecoder()
    decoder.feed(chunk, arrival_ns)
    for event in decoder.drain():       # Batch, Reply, Text, RejectedFrame, … (protocols/events.py)
        ...

    messages.py              every message, as a table
    data_identifiers.py      every MTData2 data identifier
    enums.py                 enumerations and flag words
    frames.py                scan and build frames, walk items
    stream_parser.py         frames, sentences, rejects
    decoder.py               columns, replies, time, loss
    json_codec.py            one frame as plain values and back
    binary_strings.py        the two binary strings
    products.py              MTi products
    output_configuration.py  available outputs, their rates and grouping
    commands.py              commands and settings per product
    product_options.py       flags, functions and lines of a product
    driver.py                read, write, restart
    requests.py              states, requests, time-outs, retries
    config_effects.py        effects of a change on the line
    bandwidth.py             bytes a second, rates that fit
    annotate.py              the bytes of a frame in words
    device_info.py           identity in the device's answers
    simulator/               simulated devices

Source: MT0101P revision 2020.A, with its errata.
"""
