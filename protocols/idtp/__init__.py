"""IDTP 2.1: the Inertial Measurement Unit Data Transfer Protocol.

    from imuscope.protocols.idtp.decoder import IdtpDecoder

    decoder = IdtpDecoder(key=bytes.fromhex("0001…"))       # without a key, Secure frames are rejected as no_key
    decoder.feed(chunk, arrival_ns)
    for event in decoder.drain():       # Batch, Reply, RejectedFrame, SampleGap, ClockStep (protocols/events.py)
        ...

    messages.py         every standard payload type, as a table
    custom_payloads.py  the user's description of vendor types
    frames.py           scan, verify and build frames
    replay_guard.py     replays and losses, device by device
    stream_parser.py    accepted frames, and rejects
    payloads.py         from a payload's type to its columns
    decoder.py          batches, time, loss, warnings
    json_codec.py       one frame as plain values and back
    simulator.py        a simulated sensor

Source: IDTP v2.1.0, with its errata.
"""
