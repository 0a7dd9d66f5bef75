"""Names of typing, socket and math for the holder of a shared port: they would take 1.2 MB, and it has few.

A checker of types sees those of typing; at run time only `NamedTuple` does anything.
"""

import _socket
from collections import namedtuple

INFINITY = float("inf")
TYPE_CHECKING = False

if TYPE_CHECKING:
    from typing import Any as Any
    from typing import Literal as Literal
    from typing import NamedTuple as NamedTuple
else:
    Any, Literal = object, tuple

    class _RecordType(type):
        """Makes a named tuple of a class with annotated fields, as typing.NamedTuple does."""

        def __new__(cls, name, bases, body):
            if not bases:
                return super().__new__(cls, name, bases, body)
            fields = body.pop("__annotations__")
            defaults = [body.pop(field) for field in fields if field in body]
            base = namedtuple(name, fields, defaults=defaults)
            return type(name, (base,), {"__slots__": (), **body})

    class NamedTuple(metaclass=_RecordType):
        """A named tuple with types."""


class Socket(_socket.socket):
    """socket.socket, as far as a holder uses it."""

    def accept(self) -> "tuple[Socket, Any]":
        fd, address = self._accept()  # type: ignore[attr-defined]  # which socket.accept calls too
        return Socket(fileno=fd), address
