"""One 3D scene in viser: what stands in it, and what a person can choose in viser's own panel.

    /d0                     a place of its own for each device, side by side
    /d0/name                its name
    /d0/frame               axes of the frame it speaks, and that frame's name
    /d0/body                turns
    /d0/body/mesh           a box whose lid shows forward, or an uploaded file
    /d0/body/gravity …      arrows in body axes, turned into their direction
    /d0/track               the way it came

Only what moves is sent: orientations, and positions where something moves, of the newest sample; viser itself keeps no
more than the newest of each for a browser that does not keep up. Arrows follow at `SLOW_PER_S`, the track at
`TRACK_PER_S`, because nobody sees more and each costs as much as the body. With nobody looking nothing is sent at all.

Only server/integrations/viser_worker.py imports this: viser takes seconds to import. What is private in viser and
touched here is kept in `_closed_to_strangers` (the handlers of its wire), `_at_once` (when it sends) and `_turn` (a
message of it).
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from viser import _messages

from recordings.rotations import ENU_FROM, Quaternion, Vector, about_z, from_x, multiply, yaw_of
from server.integrations.meshes import MOST_BYTES, Mesh, MeshError, read
from server.integrations.poses import DeviceView
from server.integrations.shared_secret import require_secret

SLOW_PER_S = 15.0
TRACK_PER_S = 2.0
LEAST_TURN = math.radians(0.3)  # of an arrow; less is not seen
APART = 2.4  # m between two devices; a body is at most 1 m
TRAIL_S, LONGEST_TRAIL_S = 60, 600
MOST_UPLOADS = 2  # under way at once
BODY, LID = (66, 82, 110), (240, 178, 50)
AXES = ((213, 94, 0), (0, 158, 115), (0, 114, 178))  # x, y, z: told apart by the colour-blind (Okabe and Ito)
FRAME = (120, 120, 125)
GRAVITY, FIELD, TRACK = (90, 90, 100), (170, 80, 190), (0, 114, 178)
FRAME_LABELS = {"ENU": ("east", "north", "up"), "NED": ("north", "east", "down"), "NWU": ("north", "west", "up")}
# A grid stands out equally little on the page's dark ground and on its light one: greys between both, thin, and gone
# before the horizon. viser's own is made for a white one.
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
        """Turn it into this direction; None hides it."""
        self.node.visible = to is not None
        if to is not None and (self.to is None or _angle(self.to, to) > LEAST_TURN):
            self.to = to
            _turn(self.node, from_x(to))


@dataclass(slots=True)
class SceneDevice:
    """The nodes of one device."""

    base: tuple[float, float, float]
    root: viser.FrameHandle
    frame: viser.FrameHandle
    body: viser.FrameHandle
    gravity: Arrow
    field: Arrow
    track: viser.LineSegmentsHandle
    start: Vector | None = None  # where the device was when it first told; from there it moves unless followed
    heading: float = 0.0  # rad about the frame's z axis that the display leaves out
    shown: Quaternion | None = None  # attitude that was sent last; None: it has to be sent


class Scene:
    """A viser server on a loopback port of its own.

    Args:
        title: what the panel is called.
        secret: what whoever comes has to say.
    """

    def __init__(self, title: str, secret: str) -> None:
        with require_secret(secret):
            self._server = viser.ViserServer("127.0.0.1", 0, label=title, verbose=False)
        self.port = self._server.get_port()
        self._lock = threading.RLock()
        self._looks: Sequence[DeviceView] = ()
        self._stands: dict[str, SceneDevice] = {}
        self._mesh: Mesh | None = None
        self._next_slow = self._next_track = 0.0
        _closed_to_strangers(self._server)
        _at_once(self._server)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="small")
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._controls()
        self._server.on_client_connect(lambda _: self._soon())  # what stands still is not told again by itself

    def close(self) -> None:
        """Stop serving it."""
        self._server.stop()

    def arrange(self, looks: Sequence[DeviceView]) -> None:
        """Show these devices; what was shown before goes."""
        with self._lock:
            self._looks = looks
            names = [ALL, *dict.fromkeys(look.title for look in looks)]
            self._which.options = tuple(names)
            self._which.visible = len(looks) > 1
            self._build()

    def show(self, now: float) -> None:
        """Bring what moves to where it is now.

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
            with self._server.atomic():  # one message for all that moves
                for look in self._looks:
                    stand = self._stands.get(look.id)
                    if stand is not None:
                        self._move(look, stand, slow=slow, track=track)

    # ── what moves ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _move(self, look: DeviceView, stand: SceneDevice, *, slow: bool, track: bool) -> None:
        q = look.q_frame_from_body
        if q is not None and q != stand.shown:
            stand.shown = q
            _turn(stand.body, multiply(ENU_FROM[look.frame], multiply(about_z(-stand.heading), q)))
        if slow:
            stand.gravity.point(look.gravity if self._vectors.value else None)
            stand.field.point(look.field if self._vectors.value else None)
        if look.place is None:
            return
        if stand.start is None:
            stand.start = look.place
        if slow:
            away = _minus(look.place, stand.start)
            stand.root.position = stand.base if self._follow.value else _plus(stand.base, away)
        if track:
            _draw(stand.track, look.track(self._trail.value), look.place)
        elif slow:  # the last point of the way stays at the body
            stand.track.position = (0.0, 0.0, 0.0)

    # ── what stands ──────────────────────────────────────────────────────────────────────────────────────────────────

    def _build(self) -> None:
        scene = self._server.scene
        headings = {id: (stand.heading, stand.start) for id, stand in self._stands.items()}
        scene.reset()
        scene.set_up_direction("+z")
        self._stands = {}
        shown = [look for look in self._looks if self._which.value in (ALL, look.title)]
        scene.add_grid("/ground", infinite_grid=True, position=(0.0, 0.0, -0.9), **GRID)
        for i, look in enumerate(shown):
            stand = self._stands[look.id] = self._stand(f"/d{i}", look, (APART * (i - (len(shown) - 1) / 2), 0.0, 0.0))
            stand.heading, stand.start = headings.get(look.id, (0.0, None))
        far = 1.0 + 0.45 * max(0, len(shown) - 1)
        self._server.initial_camera.position = (0.8 * far, -1.7 * far, 0.9 * far)
        self._next_slow = self._next_track = 0.0

    def _stand(self, path: str, look: DeviceView, base: tuple[float, float, float]) -> SceneDevice:
        scene = self._server.scene
        root = scene.add_frame(path, show_axes=False, position=base)
        name = f"{look.title}, {look.frame}"
        scene.add_label(f"{path}/name", name, position=(0.0, 0.0, 1.05), anchor="bottom-center")
        visible = self._frames.value
        frame = scene.add_frame(f"{path}/frame", show_axes=False, wxyz=ENU_FROM[look.frame], visible=visible)
        ends = np.eye(3, dtype=np.float32) * 0.8
        lines = np.stack((np.zeros_like(ends), ends), axis=1)
        scene.add_arrows(f"{path}/frame/axes", lines, FRAME, shaft_radius=0.006, head_radius=0.018, head_length=0.05)
        for axis, word, end in zip("xyz", FRAME_LABELS[look.frame], ends, strict=True):
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
        self._dress(path)
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

    def _dress(self, path: str) -> None:
        """Give a body its shape."""
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

    # ── what a person chooses ────────────────────────────────────────────────────────────────────────────────────────

    def _controls(self) -> None:
        gui = self._server.gui
        self._which = gui.add_dropdown("Devices", (ALL,), visible=False)
        self._follow = gui.add_checkbox("Follow", True, hint="The body stays here and its track passes by")
        self._trail = gui.add_slider("Trail, s", 0, LONGEST_TRAIL_S, 10, TRAIL_S)
        self._frames = gui.add_checkbox("Reference frame", True)
        self._vectors = gui.add_checkbox("Gravity and field", True)
        here = gui.add_button("Reset heading", hint="Show the present heading as 0; nothing is sent to the device")
        true = gui.add_button("True heading", visible=False, hint="Show the heading as the device tells it")
        self._shape: viser.GuiDropdownHandle[str] = gui.add_dropdown("Body", (BOX,))
        load = gui.add_upload_button("Load a mesh", mime_type=".glb,.stl", hint=f"GLB or STL, {MOST_BYTES >> 20} MB")

        def settle(_: Any) -> None:
            with self._lock:
                self._build()
            self.show(time.monotonic())

        def turn(reset: bool) -> None:
            with self._lock:
                for look in self._looks:
                    stand = self._stands.get(look.id)
                    if stand is not None:
                        q: Quaternion | None = look.q_frame_from_body
                        stand.heading = yaw_of(q) if reset and q is not None else 0.0
                        stand.shown = None
                true.visible = reset
            self.show(time.monotonic())

        for chosen in (self._which, self._frames, self._shape):
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
        """A mesh was uploaded: take it for all bodies, or say what is wrong with it."""
        try:
            mesh = read(name, data)
        except MeshError as error:
            if event.client is not None:
                event.client.add_notification("Not a body", str(error), color="red", auto_close_seconds=10)
            return
        with self._lock:
            self._mesh = mesh
            self._shape.options = (BOX, mesh.name)
            self._shape.value = mesh.name  # type: ignore[misc] # it has a setter, for what is no button
            self._build()


def _turn(node: viser.SceneNodeHandle, wxyz: Quaternion) -> None:
    """`node.wxyz = wxyz`, without the arrays that cost twice as much as all else of it."""
    node._impl.api._queue_scene_message(_messages.SetOrientationMessage(node._impl.name, wxyz))


def _angle(a: Vector, b: Vector) -> float:
    """Between two directions, rad."""
    cosine = sum(map(float.__mul__, a, b)) / (math.hypot(*a) * math.hypot(*b))
    return math.acos(min(1.0, max(-1.0, cosine)))


def _draw(line: viser.LineSegmentsHandle, track: np.ndarray[Any, Any], here: Vector) -> None:
    """The way as segments, seen from where the device is now."""
    points = np.asarray(np.vstack((track, here)) - here, np.float32)
    line.points = np.stack((points[:-1], points[1:]), axis=1)


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _at_once(server: viser.ViserServer) -> None:
    """Have it send what it has at once. It would gather for 17 ms before and after; ours is gathered already, by
    `atomic`, and what one browser does not take in time is replaced by the newest."""
    server._websock_server._broadcast_buffer.window_duration_sec = 0.0


def _closed_to_strangers(server: viser.ViserServer) -> None:
    """What viser's wire would let a visitor do and we do not: share the scene through another host, fill memory."""
    wire = server._websock_server
    wire.unregister_handler(_messages.ShareUrlRequest)
    wire.unregister_handler(_messages.ShareUrlDisconnect)
    gui = server.gui
    begin, part = gui._handle_file_transfer_start, gui._handle_file_transfer_part

    def bounded_start(client: Any, message: _messages.FileTransferStartUpload) -> None:
        parts = math.ceil(message.size_bytes / 1024)
        fits = 0 <= message.size_bytes <= MOST_BYTES and 0 <= message.part_count <= parts
        if fits and len(gui._current_file_upload_states) < MOST_UPLOADS:
            begin(client, message)
            return
        handle = server.get_clients().get(client)
        if handle is not None:
            words = f"A mesh may have at most {MOST_BYTES >> 20} MB."
            handle.add_notification("Not a body", words, color="red", auto_close_seconds=10)

    def bounded_part(client: Any, message: _messages.FileTransferPart) -> None:
        state = gui._current_file_upload_states.get(message.transfer_uuid)
        if state is not None and state["transferred_bytes"] + len(message.content) <= state["total_bytes"]:
            part(client, message)

    wire.unregister_handler(_messages.FileTransferStartUpload)
    wire.unregister_handler(_messages.FileTransferPart)
    wire.register_handler(_messages.FileTransferStartUpload, bounded_start)
    wire.register_handler(_messages.FileTransferPart, bounded_part)
