"""Requests of the server to the holder.

{"do": "lock"} · "unlock"        begin and end a transaction, in which clients wait
{"do": "baud", "baud": N}        change the rate of the port · "try": and back, to see whether it has that rate
{"do": "share", "share": {…}}    offer a share · "unshare", "name": end it · "drop", "number": disconnect a client
{"do": "frames", "module": "…"}  how frames are found, with "configuration": which of them configure the device
                                 (client_frames.FrameRules)
{"do": "take-over", "number": N} end the configuration that a client has not finished
{"do": "end"}                    end the holder
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from imuscope.server.extensions.shares.holder.shares import ShareAddress

if TYPE_CHECKING:
    from imuscope.server.extensions.shares.holder.process import Holder


def carry_out(holder: Holder, request: Mapping[str, Any]) -> None:
    """Carry out one request.

    Raises:
        PortError, ShareError: it cannot be carried out.
        KeyError: it is not one of these.
    """
    match request["do"]:
        case "lock":
            holder.arbiter.lock()
        case "unlock":
            holder.arbiter.unlock()
        case "baud":
            holder.port.set_baud(int(request["baud"]))
        case "try":
            holder.port.try_baud(int(request["baud"]))
        case "share":
            holder.sharing.add(ShareAddress.from_json(request["share"]))
        case "unshare":
            holder.sharing.remove(request["name"])
        case "drop":
            holder.sharing.drop(int(request["number"]))
        case "take-over":
            holder.arbiter.forget(int(request["number"]))
        case "frames":
            holder.use_frames(request["module"], request.get("configuration", ""))
        case "end":
            holder.end()
        case other:
            raise KeyError(other)
