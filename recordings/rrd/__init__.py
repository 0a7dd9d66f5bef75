"""Recordings for the Rerun viewer: `.rrd` files and live streams of the same shape.

    entities.py      which channel becomes which entity; nothing of Rerun is needed for that
    enu.py      latitude and longitude ⇄ metres on a plane
    size_limit.py      how much of a recording a viewer in a browser gets
    chunks.py      rows of a channel → columns of an entity: transforms, scalars, texts
    static.py       what never changes: the body, its axes, names and colours of curves
    blueprint.py   how the viewer opens: 3D views, track, plots, texts
    writer.py        all of it into a file: `write_rrd`

The tree of entities, which is the same for a file and for a live stream:

    /world                                        east, north, up; metres from the first place of any device
    /world/track/<device>                         the way it went, as one line
    /world/<device>                               where it is (Transform3D, translation), where it tells
    /world/<device>/<frame>                       the frame that its attitude is given in, turned into the world's
    /world/<device>/<frame>/body                  its attitude as sent (Transform3D, quaternion or matrix)
    /world/<device>/<frame>/body/{shape,axes}     what turns
    /map/<device>                                 the same on the earth (GeoPoints), and its way: /map/<device>/track
    /<device>/<quantity> [unit]                   its values (Scalars, one instance per component)
    /<device>/<quantity>/changes                  of a status word: which flags came and went (TextLog)
    /<device>/<payload> bytes                     what nobody has described, as hex (TextLog); in files only
    /events, /markers                             what happened; what a person marked (TextLog)

and three timelines: `device_time` (the device's clock mapped to the host's; the arrival where a message has none),
`arrival_time`, and `sample` (the row's number within its channel). Times are whole nanoseconds since 1970.

Only entities.py, enu.py and size_limit.py can be imported without Rerun; the others import it, which takes about a
second and therefore happens in a process of its own, or not before it is needed.
"""
