"""Links: sources of bytes. The guarantees of a link are in `imuscope.server.links.base`, the grammar of sources in
`imuscope.server.links.source_url`, the registry of kinds in `imuscope.server.links.registry`.

    link = open_link("serial:///dev/ttyUSB0?baud=921600", LinkSettings(now_ns=steady_clock()))
    await link.open(progress=print)
    while True:
        for chunk in await link.read():
            decoder.feed(chunk.data, chunk.arrival_ns)
"""
