"""Holder of a shared port: a small process that keeps the port open and hands its bytes on to several clients.

    device ══ port ══ holder ──┬── pseudo-terminal   the robot's own driver
                               ├── TCP, UDP          programs on this or another machine
                               └── Unix socket       imuscope (server/links/held.py)

It outlives the server: what a client reads and writes does not depend on imuscope, its upgrade or its end. It imports
neither numpy nor numba nor anything of the web, and runs one epoll loop in one thread.

    shares.py     addresses of shares
    messages.py   the protocol between holder and server
    queues.py     bytes on their way to a client; a slow one loses whole frames
    clients.py    the clients of each kind of share
    arbiter.py    one voice at a time towards the device
    port.py       the port
    settings.py   settings as text
    server_connection.py
    requests.py   requests of the server
    process.py    the loop
"""
