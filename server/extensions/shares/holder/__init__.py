"""Holder of a shared port: a small process that keeps the port open and hands its bytes on to several clients.

    device ══ port ══ holder ──┬── pseudo-terminal   the robot's own driver
                               ├── TCP, UDP          programs on this or another machine
                               └── Unix socket       imuscope (server/extensions/shares/shared_port_link.py)

It outlives the server: what a client reads and writes does not depend on imuscope, its upgrade or its end. It imports
neither numpy nor anything of the web, and runs one epoll loop in one thread.

    process.py        the loop: the port, and the recipients of messages
    event_loop.py     descriptors and their handlers
    port.py           the port
    shares.py         addresses of shares
    share_kinds.py    what a port is shared as
    clients.py        the clients of each kind of share
    sharing.py        all shares and their clients: who comes and leaves, what they get and may send
    queues.py         bytes on their way to a client; a slow one loses whole frames
    arbiter.py        one voice at a time towards the device
    client_frames.py  which frames of a client configure the device
    server_session.py the server: its connection (server_connection.py), messages.py
    settings.py       settings as text
"""
