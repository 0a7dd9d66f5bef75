"""Rerun blueprint: the initial layout of the viewer. Bodies and track on the left, curves on the right, events below
(live: behind them).

The track is drawn in metres, and a tab beside it has the same on a map. That tab is not in front, because the viewer
requests map tiles from an external server for a visible map, which would reveal the robot's position. Outside our page
that happens only when the user brings the map to the front. Inside our page it never happens
(server/extensions/rerun/page/start.js): there the tiles come from the configured tile server through ours, and
without one the track is shown on a plain ground.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import rerun.blueprint as rrb

from imuscope.recordings.exporters.entities import MAP, WORLD, DeviceEntity, Info
from imuscope.server.extensions.rerun.rrd.chunks import DEVICE_TIME, name_of

PLOTS_PER_DEVICE = 4  # plots of a device; the others are one click away in the viewer's own list
PREFERRED = ("euler", "vector", "scalar", "quaternion", "matrix")
_DULL = ("SampleTime", "PacketCounter")


def blueprint(
    devices: Sequence[DeviceEntity], channels: Sequence[Info], logs: Sequence[str], *, live_s: float = 0.0
) -> rrb.Blueprint:
    """Views and panels.

    Args:
        devices, channels: for which views are made; channels without rows are better left out.
        logs: entities with texts.
        live_s: plotted part of a live stream, s; 0: everything, for a recording.
    """
    infos = {int(info["id"]): info for info in channels}
    bodies = [_body(device) for device in devices if device.attitude is not None]
    tracks = [device for device in devices if device.position is not None]
    left: list[Any] = []
    if bodies:
        left.append(bodies[0] if len(bodies) == 1 else rrb.Grid(*bodies))
    if tracks:
        left.append(_track(tracks))
    if mapped := [device.position.on_map for device in tracks if device.position and device.position.on_map]:
        contents = [f"+ {name_of(path)}/**" for path in mapped]
        on_map = rrb.MapView(origin=f"/{MAP}", contents=contents, name="Map", background=rrb.MapProvider.OpenStreetMap)
        left[-1] = rrb.Tabs(left[-1], on_map, active_tab=0)
    plots = [_plots(device, infos, live_s) for device in devices]
    right = [one for one in plots if one is not None]
    log = rrb.TextLogView(origin="/", contents=[f"+ {log}" for log in logs], name="What happened") if logs else None
    if live_s and log is not None and right:
        right, log = [*right, log], None  # a row of its own would take the height of a plot
    columns: list[Any] = []
    if left:
        columns.append(left[0] if len(left) == 1 else rrb.Vertical(*left, row_shares=[3, 2]))
    if right:
        columns.append(right[0] if len(right) == 1 else rrb.Tabs(*right))
    parts: list[Any] = [rrb.Horizontal(*columns, column_shares=[1, 1][: len(columns)])] if columns else []
    if log is not None:
        parts.append(log)
    root = rrb.Vertical(*parts, row_shares=[4, 1][: len(parts)]) if parts else rrb.Vertical()
    play: Literal["following", "paused"] = "following" if live_s else "paused"
    panel = rrb.TimePanel(timeline=DEVICE_TIME, state="collapsed", play_state=play)
    side = (rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed"))
    return rrb.Blueprint(root, *side, panel, auto_views=False)


def _body(device: DeviceEntity) -> rrb.Spatial3DView:
    assert device.attitude is not None
    eye = rrb.EyeControls3D(position=(-1.9, -2.6, 1.7), look_target=(0.0, 0.0, 0.0), eye_up=(0.0, 0.0, 1.0))
    return rrb.Spatial3DView(origin=name_of((WORLD, device.name)), name=device.title, eye_controls=eye, line_grid=True)


def _track(devices: Sequence[DeviceEntity]) -> rrb.Spatial3DView:
    contents = [f"+ /{WORLD}/track/**", *(f"+ {name_of((WORLD, device.name, 'here'))}" for device in devices)]
    return rrb.Spatial3DView(origin=f"/{WORLD}", contents=contents, name="Track: m east, north, up", line_grid=True)


def _plots(device: DeviceEntity, infos: Mapping[int, Info], live_s: float) -> Any:
    """The plots of a device, the most useful first."""
    selected = [infos[number] for number in device.curves if number in infos]
    selected = [info for info in selected if info["kind"] in PREFERRED and not str(info["name"]).startswith(_DULL)]
    selected.sort(key=lambda info: PREFERRED.index(info["kind"]))
    names: set[str] = set()
    views: list[Any] = []
    for info in selected:
        if str(info["title"]) in names or len(views) == PLOTS_PER_DEVICE:
            continue
        names.add(str(info["title"]))
        paths = [curve.path for curve in device.curves[info["id"]]]
        views.append(
            rrb.TimeSeriesView(
                origin=name_of(paths[0][:1]),
                contents=[f"+ {name_of(path)}" for path in paths],
                name=paths[0][-1] if len(paths) == 1 else str(info["title"]),
                plot_legend=rrb.PlotLegend(visible=True, corner="lefttop"),
                time_ranges=_lately(live_s),
            )
        )
    if not views:
        return None
    # Live the viewer has 420 px of our page, mostly taken by its bars: in one column a plot would have 30 px.
    return rrb.Grid(*views, grid_columns=2, name=device.title) if live_s else rrb.Vertical(*views, name=device.title)


def _lately(live_s: float) -> Any:
    if not live_s:
        return None
    return rrb.VisibleTimeRange(
        DEVICE_TIME,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-live_s),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
