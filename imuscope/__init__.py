"""imuscope: inertial sensors in a browser, and their recordings in Python.

    import imuscope

    with imuscope.open("drive.mcap") as recording:
        rate = recording["Rate of turn"]
        rate.time, rate.values                 # NumPy: unix s, (n, 3)
        rate.to_pandas()                       # or to_arrow(), to_polars()
        recording.analyse("allan", "Rate of turn")
        recording.export("drive.csv")

    with imuscope.connect("http://robot.local:8080") as live:
        for batch in live.stream("Rate of turn"):
            print(batch.time[-1], batch.values[-1])

`imuscope.plugin` has the names for plug-ins. The folders of this package are links to those at the top level of the
source: imuscope.server is server/. Nothing imports the bare names, which are too common: a robot has a `server` of its
own.
"""

from importlib import import_module

TYPE_CHECKING = False  # to import typing takes half a megabyte
if TYPE_CHECKING:
    from typing import Any

    from imuscope.live import Batch, LiveSignal, Server, connect
    from imuscope.recording import Recording, open  # noqa: A004
    from imuscope.results import Calibration, Comparison
    from imuscope.signals import Device, Event, ImuscopeError, Signal

__all__ = [
    "Batch",
    "Calibration",
    "Comparison",
    "Device",
    "Event",
    "ImuscopeError",
    "LiveSignal",
    "Recording",
    "Server",
    "Signal",
    "connect",
    "open",
]
_OF_LIVE = ("Batch", "LiveSignal", "Server", "connect")
_OF_RESULTS = ("Calibration", "Comparison")
_OF_SIGNAL = ("Device", "Event", "ImuscopeError", "Signal")


def __getattr__(name: str) -> "Any":
    """A public name, imported when it is used: `imuscope --version` needs none of them."""
    if name not in __all__:
        raise AttributeError(f"module 'imuscope' has no attribute {name!r}")
    homes = (("live", _OF_LIVE), ("signals", _OF_SIGNAL), ("results", _OF_RESULTS))
    module = next((module for module, names in homes if name in names), "recording")
    return getattr(import_module(f"imuscope.{module}"), name)


def __dir__() -> list[str]:
    return [*__all__, "plugin"]
