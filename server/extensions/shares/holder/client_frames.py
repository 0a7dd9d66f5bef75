"""Frames of a client on their way to the device: which of them configure it.

A protocol family names modules for this (protocols/family/info.py: `frame_size`, `configuration`); without them nothing
is recognised. The bytes are passed on as they come, whatever is found in them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib.util import find_spec, module_from_spec, spec_from_file_location

from imuscope.server.extensions.shares.holder.queues import FrameSize
from imuscope.server.system.light_modules import Any, Literal, NamedTuple

MOST_PARTIAL = 4096  # bytes without the end of a frame, after which the search restarts

Effect = Literal["", "begin", "change", "end"]
"""Effect of a frame: it begins a configuration that ends with an "end", changes settings at once, ends one; or none."""
EffectOf = Callable[[bytes], Effect]


class FrameRules(NamedTuple):
    """Rules of a family: how frames are found, and which of them configure the device; None: unknown."""

    size: FrameSize | None = None
    effect: EffectOf | None = None

    @classmethod
    def of(cls, frames: str, configuration: str) -> FrameRules:
        """The rules of modules with `frame_size` and `effect_of`; "" for none.

        Raises:
            ImportError: there is no such module.
            AttributeError: it lacks the function.
        """
        size = load_alone(frames).frame_size if frames else None
        return cls(size, load_alone(configuration).effect_of if configuration else None)


def load_alone(name: str) -> Any:
    """A module without what its package imports: a family's package may need numpy, which is too large for a holder.

    Raises:
        ImportError: there is no such module.
    """
    package, _, own = name.rpartition(".")
    location = find_spec(package) if package else None
    for folder in (location.submodule_search_locations or ()) if location is not None else ():
        spec = spec_from_file_location(name, path := os.path.join(folder, f"{own}.py"))
        if spec is not None and spec.loader is not None and os.path.isfile(path):
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            return module
    raise ImportError(f"no module {name!r}")


class ClientFrames:
    """Bytes of one client in, effects of its frames out."""

    def __init__(self) -> None:
        self._partial = b""

    @property
    def is_between(self) -> bool:
        """Whether the last frame was complete."""
        return not self._partial

    def feed(self, data: bytes, rules: FrameRules) -> Iterator[Effect]:
        """The effects of the frames that end in `data`."""
        size_of, effect_of = rules.size, rules.effect
        if size_of is None or effect_of is None:
            return
        data, at = self._partial + data, 0
        while at < len(data):
            size = size_of(data, at)
            if size < 0:
                at += 1
                continue
            if size == 0 or at + size > len(data):
                break
            if effect := effect_of(data[at : at + size]):
                yield effect
            at += size
        rest = data[at:]
        self._partial = rest if len(rest) <= MOST_PARTIAL else b""
