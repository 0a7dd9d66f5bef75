"""3D scene in viser: its objects, and the controls in viser's own panel.

    /d0                     origin of each device, side by side
    /d0/name                its name
    /d0/frame               axes of the device's frame, and the frame's name
    /d0/body                rotates
    /d0/body/mesh           a box whose lid shows forward, or an uploaded file
    /d0/body/gravity …      arrows in body axes
    /d0/track               its track

Only changes are sent: orientations, and positions if something moves, of the newest sample; viser keeps only the newest
of each for a slow browser. Arrows are updated at `SLOW_PER_S`, the track at `TRACK_PER_S`, because more is not visible
and each costs as much as the body. Without viewers nothing is sent.

Only server/extensions/viser/worker.py imports this: viser takes seconds to import. Private parts of viser are used
only in `_restrict_clients` (its message handlers), `_at_once` (its send buffer) and `_turn` (a message).
"""

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from viser import _messages

from imuscope.protocols.rotations import ENU_FROM, Quaternion, Vector, euler_of, from_x, multiply
from imuscope.server.extensions.viser.meshes import MAX_BYTES, Mesh, MeshError, read
from imuscope.server.extensions.viser.poses import DeviceView
from imuscope.server.integrations.shared_secret import require_secret

SLOW_PER_S = 15.0
TRACK_PER_S = 2.0
MIN_TURN = math.radians(0.3)  # of an arrow; less is not visible
SPACING_M = 2.4  # m between two devices; a body is at most 1 m
TRAIL_S, LONGEST_TRAIL_S = 60, 600
MAX_UPLOADS = 2  # under way at once
BODY, LID = (66, 82, 110), (240, 178, 50)
AXES = ((213, 94, 0), (0, 158, 115), (0, 114, 178))  # x, y, z: distinguishable by colour-blind users (Okabe and Ito)
FRAME = (120, 120, 125)
GRAVITY, FIELD, TRACK = (90, 90, 100), (170, 80, 190), (0, 114, 178)
FRAME_LABELS = {"ENU": ("east", "north", "up"), "NED": ("north", "east", "down"), "NWU": ("north", "west", "up")}
# A grid that is unobtrusive on the page's dark and light backgrounds: thin, in a grey between both, fading before the
# horizon. viser's default is made for a white background.
GRID: dict[str, Any] = {
    "cell_size": 0.5,
    "section_size": 2.5,
    "cell_color": (100, 106, 114),
    "section_color": (100, 106, 114),
    "cell_thickness": 0.4,
    "section_thickness": 0.8,
    "fade_distance": 14.0,
    "fade_strength": 1.5,
}
ALL = "All, side by side"
BOX = "Sensor"


@dataclass(slots=True)
class Arrow:
    """An arrow in body axes."""

    node: viser.SceneNodeHandle
    to: Vector | None = None

    def point(self, to: Vector | None) -> None:
        """Point it in this direction; None hides it."""
        self.node.visible = to is not None
        if to is not None and (self.to is None or _angle(self.to, to) > MIN_TURN):
            self.to = to
            _turn(self.node, from_x(to))


@dataclass(slots=True)
class SceneDevice:
    """Scene nodes of one device: frame, mesh, track and label."""

    base: tuple[float, float, float]
    root: viser.FrameHandle
    frame: viser.FrameHandle
    body: viser.FrameHandle
    gravity: Arrow
    field: Arrow
    track: viser.LineSegmentsHandle
    start: Vector | None = None  # first position of the device; unless followed, it moves relative to it
    heading: float = 0.0  # rotation about the frame's z axis, rad, removed from the display
    shown: Quaternion | None = None  # attitude that was sent last; None: it must be sent


class Scene:
    """A viser server on its own loopback port.

    Args:
        title: title of the panel.
        secret: secret required from clients.
    """

    def __init__(self, title: str, secret: str) -> None:
        with require_secret(secret):
            self._server = viser.ViserServer("127.0.0.1", 0, label=title, verbose=False)
        self.port = self._server.get_port()
        self._lock = threading.RLock()
        self._appearances: Sequence[DeviceView] = ()
        self._device_nodes: dict[str, SceneDevice] = {}
        self._mesh: Mesh | None = None
        self._next_slow = self._next_track = 0.0
        _restrict_clients(self._server)
        _at_once(self._server)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="small")
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._controls()
        self._server.on_client_connect(lambda _: self._soon())  # objects that do not move are not sent again otherwise

    def close(self) -> None:
        """Stop serving it."""
        self._server.stop()

    def configure(self, views: Sequence[DeviceView]) -> None:
        """Show these devices instead of the previous ones."""
        with self._lock:
            self._appearances = views
            names = [ALL, *dict.fromkeys(view.title for view in views)]
            self._device_at.options = tuple(names)
            self._device_at.visible = len(views) > 1
            self._build()

    def show(self, now: float) -> None:
        """Update moving objects.

        Args:
            now: monotonic, s.
        """
        with self._lock:
            if not self._server.get_clients():
                return
            slow, track = now >= self._next_slow, now >= self._next_track
            if slow:
                self._next_slow = now + 1 / SLOW_PER_S
            if track:
                self._next_track = now + 1 / TRACK_PER_S
            with self._server.atomic():  # one message for all moving objects
                for view in self._appearances:
                    scene_device = self._device_nodes.get(view.id)
                    if scene_device is not None:
                        self._move(view, scene_device, slow=slow, track=track)

    # ── moving objects ───────────────────────────────────────────────────────────────────────────────────────────────

    def _move(self, view: DeviceView, scene_device: SceneDevice, *, slow: bool, track: bool) -> None:
        q = view.q_frame_from_body
        if q is not None and q != scene_device.shown:
            scene_device.shown = q
            _turn(scene_device.body, multiply(ENU_FROM[view.frame], multiply(_about_z(-scene_device.heading), q)))
        if slow:
            scene_device.gravity.point(view.gravity if self._vectors.value else None)
            scene_device.field.point(view.field if self._vectors.value else None)
        if view.place is None:
            return
        if scene_device.start is None:
            scene_device.start = view.place
        if slow:
            away = _minus(view.place, scene_device.start)
            scene_device.root.position = scene_device.base if self._follow.value else _plus(scene_device.base, away)
        if track:
            _draw(scene_device.track, view.track(self._trail.value), view.place)
        elif slow:  # the last point of the track stays at the body
            scene_device.track.position = (0.0, 0.0, 0.0)

    # ── static objects ───────────────────────────────────────────────────────────────────────────────────────────────

    def _build(self) -> None:
        scene = self._server.scene
        headings = {key: (node.heading, node.start) for key, node in self._device_nodes.items()}
        scene.reset()
        scene.set_up_direction("+z")
        self._device_nodes = {}
        shown = [view for view in self._appearances if self._device_at.value in (ALL, view.title)]
        scene.add_grid("/ground", infinite_grid=True, position=(0.0, 0.0, -0.9), **GRID)
        for i, view in enumerate(shown):
            scene_device = self._device_nodes[view.id] = self._device_node(
                f"/d{i}", view, (SPACING_M * (i - (len(shown) - 1) / 2), 0.0, 0.0)
            )
            scene_device.heading, scene_device.start = headings.get(view.id, (0.0, None))
        far = 1.0 + 0.45 * max(0, len(shown) - 1)
        self._server.initial_camera.position = (0.8 * far, -1.7 * far, 0.9 * far)
        self._next_slow = self._next_track = 0.0

    def _device_node(self, path: str, view: DeviceView, base: tuple[float, float, float]) -> SceneDevice:
        scene = self._server.scene
        root = scene.add_frame(path, show_axes=False, position=base)
        name = f"{view.title}, {view.frame}"
        scene.add_label(f"{path}/name", name, position=(0.0, 0.0, 1.05), anchor="bottom-center")
        visible = self._frames.value
        frame = scene.add_frame(f"{path}/frame", show_axes=False, wxyz=ENU_FROM[view.frame], visible=visible)
        ends = np.eye(3, dtype=np.float32) * 0.8
        lines = np.stack((np.zeros_like(ends), ends), axis=1)
        scene.add_arrows(f"{path}/frame/axes", lines, FRAME, shaft_radius=0.006, head_radius=0.018, head_length=0.05)
        for axis, word, end in zip("xyz", FRAME_LABELS[view.frame], ends, strict=True):
            self._small(f"{path}/frame/{axis}", f"{axis} {word}", tuple(1.08 * end))
        body = scene.add_frame(f"{path}/body", show_axes=False)
        scene.add_arrows(
            f"{path}/body/axes",
            lines * np.float32(0.8),
            np.array(AXES),
            shaft_radius=0.012,
            head_radius=0.03,
            head_length=0.08,
        )
        self._style(path)
        gravity = self._arrow(f"{path}/body/gravity", "gravity", GRAVITY)
        field = self._arrow(f"{path}/body/field", "magnetic field", FIELD)
        track = scene.add_line_segments(
            f"{path}/track", np.zeros((0, 2, 3), np.float32), np.array(TRACK), thickness=2.0, thickness_units="screen"
        )
        return SceneDevice(base, root, frame, body, gravity, field, track)

    def _arrow(self, name: str, words: str, colour: tuple[int, int, int]) -> Arrow:
        scene = self._server.scene
        node = scene.add_frame(name, show_axes=False, visible=False)
        line = np.array([[[0, 0, 0], [0.75, 0, 0]]], np.float32)
        scene.add_arrows(f"{name}/line", line, colour, shaft_radius=0.012, head_radius=0.03, head_length=0.08)
        self._small(f"{name}/name", words, (0.84, 0.0, 0.0))
        return Arrow(node)

    def _small(self, name: str, words: str, place: tuple[float, ...]) -> None:
        at = (place[0], place[1], place[2])
        self._server.scene.add_label(name, words, position=at, anchor="center-center", font_screen_scale=0.75)

    def _style(self, path: str) -> None:
        scene, mesh, name = self._server.scene, self._mesh, f"{path}/body/mesh"
        if mesh is None or self._shape.value == BOX:
            scene.add_box(name, BODY, (0.56, 0.38, 0.14))
            scene.add_box(f"{name}/lid", LID, (0.12, 0.3, 0.05), position=(0.2, 0.0, 0.08))
        elif mesh.glb:
            scene.add_glb(name, mesh.glb, scale=0.8 * mesh.scale)
        else:
            scene.add_mesh_simple(
                name, mesh.vertices, mesh.faces, color=BODY, flat_shading=True, side="double", scale=0.8 * mesh.scale
            )

    # ── controls ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def _controls(self) -> None:
        gui = self._server.gui
        self._device_at = gui.add_dropdown("Devices", (ALL,), visible=False)
        self._follow = gui.add_checkbox("Follow", True, hint="The body stays here and its track passes by")
        self._trail = gui.add_slider("Trail, s", 0, LONGEST_TRAIL_S, 10, TRAIL_S)
        self._frames = gui.add_checkbox("Reference frame", True)
        self._vectors = gui.add_checkbox("Gravity and field", True)
        here = gui.add_button("Reset heading", hint="Show the present heading as 0; nothing is sent to the device")
        true = gui.add_button("True heading", visible=False, hint="Show the heading as sent by the device")
        self._shape: viser.GuiDropdownHandle[str] = gui.add_dropdown("Body", (BOX,))
        load = gui.add_upload_button("Load a mesh", mime_type=".glb,.stl", hint=f"GLB or STL, {MAX_BYTES >> 20} MB")

        def settle(_: Any) -> None:
            with self._lock:
                self._build()
            self.show(time.monotonic())

        def turn(reset: bool) -> None:
            with self._lock:
                for view in self._appearances:
                    scene_device = self._device_nodes.get(view.id)
                    if scene_device is not None:
                        q: Quaternion | None = view.q_frame_from_body
                        scene_device.heading = float(euler_of(np.array(q))[2]) if reset and q is not None else 0.0
                        scene_device.shown = None
                true.visible = reset
            self.show(time.monotonic())

        for chosen in (self._device_at, self._frames, self._shape):
            chosen.on_update(settle)
        for moved in (self._follow, self._trail, self._vectors):
            moved.on_update(lambda _: self._soon())
        here.on_click(lambda _: turn(True))
        true.on_click(lambda _: turn(False))
        load.on_upload(lambda event: self._load(event, load.value.name, load.value.content))

    def _soon(self) -> None:
        with self._lock:
            self._next_slow = self._next_track = 0.0
        self.show(time.monotonic())

    def _load(self, event: Any, name: str, data: bytes) -> None:
        """Use an uploaded mesh for all bodies, or notify the user of its error."""
        try:
            mesh = read(name, data)
        except MeshError as error:
            if event.client is not None:
                event.client.add_notification("Not a body", str(error), color="red", auto_close_seconds=10)
            return
        with self._lock:
            self._mesh = mesh
            self._shape.options = (BOX, mesh.name)
            self._shape.value = mesh.name  # type: ignore[misc] # it has a setter, except for buttons
            self._build()


def _turn(node: viser.SceneNodeHandle, wxyz: Quaternion) -> None:
    """Same as `node.wxyz = wxyz`, without its arrays, which take two thirds of the time."""
    node._impl.api._queue_scene_message(_messages.SetOrientationMessage(node._impl.name, wxyz))


def _about_z(angle: float) -> Quaternion:
    return (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))


def _angle(a: Vector, b: Vector) -> float:
    """Angle between two directions, rad."""
    cosine = sum(map(float.__mul__, a, b)) / (math.hypot(*a) * math.hypot(*b))
    return math.acos(min(1.0, max(-1.0, cosine)))


def _draw(line: viser.LineSegmentsHandle, track: np.ndarray[Any, Any], here: Vector) -> None:
    """Draw the track as segments relative to the present position of the device."""
    points = np.asarray(np.vstack((track, here)) - here, np.float32)
    line.points = np.stack((points[:-1], points[1:]), axis=1)


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _at_once(server: viser.ViserServer) -> None:
    """Send buffered messages at once. viser would collect them for 17 ms before and after; ours are collected already,
    by `atomic`, and messages that a browser does not accept in time are replaced by newer ones.
    """
    server._websock_server._broadcast_buffer.window_duration_sec = 0.0


def _restrict_clients(server: viser.ViserServer) -> None:
    """Disable actions of viser's clients that share the scene through another host or fill memory."""
    wire = server._websock_server
    wire.unregister_handler(_messages.ShareUrlRequest)
    wire.unregister_handler(_messages.ShareUrlDisconnect)
    gui = server.gui
    begin, part = gui._handle_file_transfer_start, gui._handle_file_transfer_part

    def bounded_start(client: Any, message: _messages.FileTransferStartUpload) -> None:
        parts = math.ceil(message.size_bytes / 1024)
        fits = 0 <= message.size_bytes <= MAX_BYTES and 0 <= message.part_count <= parts
        if fits and len(gui._current_file_upload_states) < MAX_UPLOADS:
            begin(client, message)
            return
        handle = server.get_clients().get(client)
        if handle is not None:
            words = f"A mesh may have at most {MAX_BYTES >> 20} MB."
            handle.add_notification("Not a body", words, color="red", auto_close_seconds=10)

    def bounded_part(client: Any, message: _messages.FileTransferPart) -> None:
        state = gui._current_file_upload_states.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] + len(message.content) <= state["total_bytes"]:
            part(client, message)

    wire.unregister_handler(_messages.FileTransferStartUpload)
    wire.unregister_handler(_messages.FileTransferPart)
    wire.register_handler(_messages.FileTransferStartUpload, bounded_start)
    wire.register_handler(_messages.FileTransferPart, bounded_part)
