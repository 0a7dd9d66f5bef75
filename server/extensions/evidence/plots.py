"""The plots of evidence that names none: every quantity with a number, one plot for each unit of a channel."""

from __future__ import annotations

from collections.abc import Iterable

from imuscope.server.extensions.evidence.request import Colour, EvidencePlot, EvidenceSeries
from imuscope.server.wire import ChannelInfo, ColumnInfo

MOST = 40
KINDS = ("vector", "euler", "scalar", "quaternion", "record")
_COLOURS: dict[str, Colour] = {"x": "axis-x", "y": "axis-y", "z": "axis-z", "w": "axis-n"}
_AXES: tuple[Colour, ...] = ("axis-x", "axis-y", "axis-z", "axis-n")
_DASHES: tuple[list[float], ...] = ([], [5.0, 3.0], [1.5, 2.5])
_TOGETHER = 4  # curves in a plot


def all_plots(infos: Iterable[ChannelInfo], devices: int) -> list[EvidencePlot]:
    """Plots of the channels, in their order.

    Args:
        devices: number of devices; with several, titles and signals name theirs.
    """
    plots: list[EvidencePlot] = []
    for info in infos:
        if info.kind not in KINDS:
            continue
        units: dict[str, list[ColumnInfo]] = {}
        for column in info.columns:
            is_number = not column.bits and not column.choices
            if is_number and (column.unit or info.unit or info.kind != "record"):
                units.setdefault(column.unit or info.unit, []).append(column)
        for unit, columns in units.items():
            for first in range(0, len(columns), _TOGETHER):
                plots.append(_plot(info, unit, columns[first : first + _TOGETHER], len(units) > 1, devices))
    return plots[:MOST]


def _plot(info: ChannelInfo, unit: str, columns: list[ColumnInfo], is_part: bool, devices: int) -> EvidencePlot:
    title = info.title or info.name
    words = [title, info.group, f"device {info.device}" if devices > 1 else ""]
    if is_part:
        words.append(", ".join(column.label or column.name for column in columns))
    prefix = f"{info.device}/" if devices > 1 else ""
    series = [
        EvidenceSeries(
            f"{prefix}{info.name}.{column.name}",
            label=column.label or column.name,
            colour=_COLOURS.get(column.axis, _AXES[number % len(_AXES)]),
            dash=[] if column.axis else _DASHES[number // len(_AXES) % len(_DASHES)],
            decimals=column.decimals,
            period=column.period,
        )
        for number, column in enumerate(columns)
    ]
    return EvidencePlot(" · ".join(filter(None, words)), unit, series)
