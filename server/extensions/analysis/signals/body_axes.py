"""Axes of two devices: what B measured, in the axes of A.

    body    FLU  x forward, y left, z up        FRD  x forward, y right, z down      half a turn about x apart
    world   ENU, NED, NWU                       of attitudes: q_A = q_(A from B) ⊗ q_B ⊗ q_(body of B from body of A)

Numbers of different axes are never subtracted: signals that cannot be converted are refused.
"""

from dataclasses import replace

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import ENU_FROM, conjugate, euler_columns, product, quaternions
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.signals import ReadSamples, Signal, SignalColumn
from imuscope.server.wire import ChannelInfo

HALF_TURN = np.array([0.0, 1.0, 0.0, 0.0])  # about x: FLU in FRD, and back
ATTITUDES = ("quaternion", "euler")


def attitude_of(info: ChannelInfo, read: ReadSamples) -> tuple[Floats, Floats]:
    """Times and unit quaternions, (n, 4), of a channel that is an attitude."""
    pairs = [read(SignalColumn(info, at)) for at in range(len(info.columns))]
    time, columns = pairs[0][0], [values for _, values in pairs]
    scale = np.degrees(1) if info.kind == "euler" and info.columns[0].unit == "rad" else 1.0
    rows = quaternions(info.kind, [scale * column for column in columns])
    is_valid = np.isfinite(rows).all(axis=1)
    return time[is_valid], rows[is_valid]


def turned(a: SignalColumn, b: SignalColumn, q: Floats) -> Floats:
    """Attitudes of B as those of a body with the axes of A, in the world of A.

    Raises:
        DomainError: "not-alike": a world that is not known.
    """
    worlds = [_world(one.info) for one in (a, b)]
    if worlds[0] != worlds[1]:
        if not set(worlds) <= set(ENU_FROM):
            raise _unlike(a, b)
        own, other = (np.array(ENU_FROM[world]) for world in worlds)
        q = product(product(conjugate(own), other), q)
    return product(q, HALF_TURN) if _differ(a, b) else q


def in_axes_of(a: SignalColumn, b: SignalColumn, signal: Signal, read: ReadSamples) -> Signal:
    """A signal of B in the axes of A, with a note if that changed it.

    Args:
        a, b: the columns that are compared.
        signal: of b.
        read: samples of B.

    Raises:
        DomainError: "not-alike": it cannot be converted.
    """
    if a.info.kind in ATTITUDES and b.info.kind == a.info.kind:
        if not _differ(a, b) and _world(a.info) == _world(b.info):
            return signal
        time, q = attitude_of(b.info, read)
        q = turned(a, b, q)
        columns = euler_columns(list(q.T)) if b.info.kind == "euler" else list(q.T)
        values = columns[b.at] * (np.radians(1) if b.info.columns[b.at].unit == "rad" else 1.0)
        return _noted(replace(signal, time=time, values=values), a, b)
    if a.info.kind != "vector" or b.info.kind != "vector":
        return signal
    if (_world(a.info), _world(b.info)) != ("", ""):
        if _world(a.info) != _world(b.info):
            raise _unlike(a, b)
        return signal
    if not _differ(a, b):
        return signal
    sign = 1.0 if b.info.columns[b.at].axis == "x" else -1.0
    return _noted(replace(signal, values=sign * signal.values), a, b)


def _differ(a: SignalColumn, b: SignalColumn) -> bool:
    return bool(a.axes and b.axes) and a.axes != b.axes


def _world(info: ChannelInfo) -> str:
    """The world along whose axes the numbers are; "" for the body's own."""
    world = info.frame.removesuffix(" from body")
    return "" if world == "body" else world


def _named(one: SignalColumn) -> str:
    return " and ".join(filter(None, (_world(one.info), one.axes)))


def _noted(signal: Signal, a: SignalColumn, b: SignalColumn) -> Signal:
    words = f"B is shown in the axes of A: {_named(b)} turned to {_named(a)}."
    return replace(signal, notes=(*signal.notes, words))


def _unlike(a: SignalColumn, b: SignalColumn) -> DomainError:
    names = [_world(one.info) or "the body" for one in (a, b)]
    message = f"{a.name} is along the axes of {names[0]}, and {b.name} of {names[1]}."
    return DomainError("not-alike", message, "Compare signals along the same axes.")
