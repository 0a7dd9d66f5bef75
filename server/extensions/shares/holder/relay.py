"""The loop of a shared port as machine code: loaded without numpy, and called with what the holder has.

It takes the place of the holder's own loop while every client keeps up; one that does not is served by Python until its
queue is empty. `server/extensions/shares/relay_kernel.py` is the function, and its documentation.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from typing import Any

from imuscope.server.extensions.shares.holder.clients import Client, UdpClient
from imuscope.server.extensions.shares.holder.port import Port
from imuscope.server.extensions.shares.holder.server_connection import ServerConnection

MOST_CLIENTS = 4
TIME_IS_OVER, OTHERS, PORT_FAILED, LEFT_OVER = 0, 1, -1, 2
SECOND_NS = 1e9


class Relay:
    """The loop.

    Args:
        path, name: of the library and of the function in it (relay_kernel.place).

    Raises:
        ImportError, AttributeError: it cannot be loaded.
    """

    def __init__(self, path: str, name: str) -> None:
        spec = spec_from_loader("imuscope_native.kernels", ExtensionFileLoader("imuscope_native.kernels", path))
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        self._function: Any = getattr(module, name)
        self._left_over, self._spill = os.pipe()

    @staticmethod
    def serves(port: Port, clients: Sequence[Client], server: ServerConnection | None) -> bool:
        """Whether it can pass on now: nothing waits anywhere."""
        return (
            port.is_open
            and not port.backlog
            and len(clients) <= MOST_CLIENTS
            and all(type(one) is not UdpClient and not one.queue.size for one in clients)
            and (server is None or not server.backlog)
        )

    def run(
        self, port: Port, epoll: int, clients: Sequence[Client], server: ServerConnection | None, until: float
    ) -> tuple[int, bytes, Sequence[int]]:
        """Pass on bytes of the device until a time, monotonic, s.

        Returns:
            state, and the last read with what each client has taken of it if one has not taken it all.
        """
        descriptors = [*(one.fd for one in clients), *(-1,) * (MOST_CLIENTS - len(clients))]
        state, total, size, *rest = self._function(
            port.fd,
            epoll,
            tuple(descriptors),
            -1 if server is None else server.fd,
            self._spill,
            int(until * SECOND_NS),
        )
        counts, unsent = rest[: len(clients)], rest[MOST_CLIENTS]
        last = b""
        for client, count in zip(clients, counts, strict=True):
            client.sent += total - size + max(count, 0)
            if count < size:
                last = last or os.read(self._left_over, size)
        if unsent and server is not None:
            server.keep(os.read(self._left_over, unsent))
        return state, last, counts

    def close(self) -> None:
        os.close(self._left_over)
        os.close(self._spill)
