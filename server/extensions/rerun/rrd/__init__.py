"""Recordings for the Rerun viewer: `.rrd` files and live streams of the same shape.

    size_limit.py  share of a recording that a viewer in a browser gets
    chunks.py      rows of a channel → columns of an entity: transforms, scalars, texts
    static.py      static entities: the body, its axes, names and colours of curves
    blueprint.py   initial layout of the viewer: 3D views, track, plots, texts
    writer.py      all of it into a file: `write_rrd`

The tree of entities, which is the same for a file and for a live stream:

    /world                                        east, north, up; metres from the first position of any device
    /world/track/<device>                         its track, as one line
    /world/<device>                               its position (Transform3D, translation), if known
    /world/<device>/<frame>                       the frame of its attitude, rotated into the world's
    /world/<device>/<frame>/body                  its attitude as sent (Transform3D, quaternion or matrix)
    /world/<device>/<frame>/body/{shape,axes}     the rotating shape and axes
    /map/<device>                                 the same on the earth (GeoPoints), and its track: /map/<device>/track
    /<device>/<quantity> [unit]                   its values (Scalars, one instance per component)
    /<device>/<quantity>/changes                  of a status word: flags that were set or cleared (TextLog)
    /<device>/<payload> bytes                     undescribed payloads, as hex (TextLog); in files only
    /events, /markers                             events; the user's markers (TextLog)

and three timelines: `device_time` (the device's clock mapped to the host's; the arrival if a message has none),
`arrival_time`, and `sample` (the row's number within its channel). Times are whole nanoseconds since 1970.

recordings/exporters/entities.py maps channels to entities, recordings/exporters/enu.py positions to metres on a plane.

Only size_limit.py can be imported without Rerun; the others import it, which takes about a
second and therefore happens in a subprocess, or on first use.
"""
