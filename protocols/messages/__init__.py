"""Messages with a schema, as other programs send and record them: ROS 2, Foxglove, JSON, protobuf.

    records.py      the stream: schemas, channels and messages, framed as in an MCAP file
    ros2msg.py      types from the text of their definitions
    cdr.py          numbers of ROS 2 messages, many at once
    walkers.py      numbers of JSON and protobuf messages
    own_schema.py   quantities of imuscope's own JSON messages
    quantities.py   numbers by path → quantities with units, axes and frames
    decoder.py      the stream → batches
    family.py       what the rest of the program knows of them

A link that receives messages (server/links/) and a file of messages (recordings/mcap/messages.py) give the same stream,
so that both are shown, recorded, exported and replayed alike.
"""
