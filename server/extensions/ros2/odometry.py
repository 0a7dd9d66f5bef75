"""Position and velocity with accuracies as ROS knows them: velocity in the map, and odometry. Pure.

    twist       geometry_msgs/msg/TwistWithCovarianceStamped    velocity east, north, up, in the frame of the map
    odometry    nav_msgs/msg/Odometry                           pose in the frame of the map, from the first position;
                                                                velocity and rate of turn in that of the device

Each exists where the device sends the quantity with its accuracy, or `ros2_covariances` has one. A velocity has no rate
of turn with it: element 21 of the covariance, the first of the angular part, is −1, as drivers of receivers have it. An
attitude of unknown accuracy has the variance of an angle that may be anything, π²/3.

Source: common_interfaces (Jazzy); REP 103, REP 105: the pose is in header.frame_id, the twist in child_frame_id.
"""

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import to_body
from imuscope.recordings.exporters.enu import Origin, enu_of, enu_turns, is_place
from imuscope.server.extensions.ros2.axes import world_vectors
from imuscope.server.extensions.ros2.covariances import NOT_KNOWN_HEADING, SensorNoise
from imuscope.server.extensions.ros2.joined_rows import RowBlock, RowJoin
from imuscope.server.extensions.ros2.message_builder import (
    Columns,
    FrameNames,
    Mask,
    MessageBuilder,
    attitudes,
    in_body_axes,
    xyz,
)
from imuscope.server.extensions.ros2.quantities import WORLD_FRAMES, DeviceQuantities, Place

TWIST, ODOMETRY = "geometry_msgs/msg/TwistWithCovarianceStamped", "nav_msgs/msg/Odometry"
AXIS_COUNT = 6  # x, y, z, then about x, y, z


def twist(of: DeviceQuantities, frames: FrameNames, noise: SensorNoise) -> MessageBuilder | None:
    """The builder of velocities; None without a velocity that has an accuracy."""
    speed = of.speed
    if speed is None or not frames.rep103 or not (speed.accuracy or noise.deviation("velocity")):
        return None
    others = {"accuracy": speed.accuracy, "place": of.fix.place if of.fix else None}
    if speed.place.frame not in WORLD_FRAMES and not others["place"]:
        return None

    def columns(block: RowBlock, rate: float) -> Columns:
        vectors = _enu(block.values, speed.place.frame, block.others.get("place"))
        sigma = _sigma(block, "accuracy", noise.deviation("velocity"))
        covariance = _covariance([sigma, sigma, sigma])
        covariance[:, 3 * AXIS_COUNT + 3] = -1.0
        return {**xyz("twist.twist.linear", vectors), "twist.covariance": covariance}

    def keep(block: RowBlock) -> Mask:
        vectors = _enu(block.values, speed.place.frame, block.others.get("place"))
        return _finite(vectors, _sigma(block, "accuracy", noise.deviation("velocity")))

    return _builder(TWIST, speed.place, others, columns, {"header.frame_id": frames.map}, keep)


def odometry(of: DeviceQuantities, frames: FrameNames, noise: SensorNoise) -> MessageBuilder | None:
    """The builder of odometry; None without position and velocity with accuracies, and an attitude."""
    fix, speed, attitude = of.fix, of.speed, of.attitude_place
    if fix is None or speed is None or attitude is None or not frames.rep103 or fix.height is None:
        return None
    has_accuracy = (fix.horizontal and fix.vertical) or noise.deviation("position")
    if not (has_accuracy and (speed.accuracy or noise.deviation("velocity"))):
        return None
    others = {
        **{"height": fix.height, "horizontal": fix.horizontal, "vertical": fix.vertical, "velocity": speed.place},
        **{"accuracy": speed.accuracy, "attitude": attitude, "turn": of.turn},
    }
    origin: list[Origin] = []

    def parts(block: RowBlock) -> tuple[Floats, list[Floats], Floats, Floats]:
        """Velocity in the map, standard deviations, attitude and height."""
        velocity = _enu(block.others["velocity"], speed.place.frame, block.values)
        sigmas = [
            _sigma(block, "horizontal", noise.deviation("position")),
            _sigma(block, "vertical", noise.deviation("position")),
            _sigma(block, "accuracy", noise.deviation("velocity")),
        ]
        return velocity, sigmas, attitudes(of, frames, noise, block.others["attitude"]), block.others["height"][:, 0]

    def columns(block: RowBlock, rate: float) -> Columns:
        velocity, (flat, up, sigma), q, height = parts(block)
        lat, lon = block.values.T
        if not origin:
            origin.append(Origin(float(lat[0]), float(lon[0]), float(height[0])))
        n = len(block.times)
        tilt, heading = noise.deviation("tilt"), noise.deviation("heading") or NOT_KNOWN_HEADING
        angles = [np.full(n, one) for one in ((tilt, tilt, heading) if tilt else (NOT_KNOWN_HEADING,) * 3)]
        turn = block.others.get("turn", np.full((n, 3), np.nan))
        density = noise.deviation("turn", rate)
        moving = _covariance([sigma] * 3 + [np.full(n, density)] * 3)
        is_known = np.asarray(np.isfinite(turn).all(axis=1)) & (density > 0)
        moving[~is_known, 3 * AXIS_COUNT + 3] = -1.0
        return {
            **xyz("pose.pose.position", enu_of(lat, lon, height, origin[0])),
            **{f"pose.pose.orientation.{axis}": q[:, at] for at, axis in enumerate("wxyz")},
            "pose.covariance": _covariance([flat, flat, up, *angles]),
            **xyz("twist.twist.linear", to_body(q, velocity)),
            **xyz("twist.twist.angular", in_body_axes(np.where(np.isfinite(turn), turn, 0.0), frames, noise)),
            "twist.covariance": moving,
        }

    def keep(block: RowBlock) -> Mask:
        velocity, sigmas, q, height = parts(block)
        return is_place(block.values[:, 0], block.values[:, 1]) & _finite(velocity, *sigmas, q, height)

    texts = {"header.frame_id": frames.map, "child_frame_id": frames.device}
    return _builder(ODOMETRY, fix.place, others, columns, texts, keep)


def _builder(
    type_name: str, driver: Place, others: dict[str, Place | None], columns: object, texts: object, keep: object
) -> MessageBuilder:
    there = {name: place for name, place in others.items() if place}
    channels = {driver.channel, *(place.channel for place in there.values())}
    return MessageBuilder(type_name, RowJoin(driver, there), channels, columns, texts, keep=keep)  # type: ignore[arg-type]


def _enu(vectors: Floats, frame: str, places: Floats | None) -> Floats:
    """Velocities as ENU. Args: places: (n, 2) latitude and longitude, °, for those against the earth's axes."""
    if frame in WORLD_FRAMES:
        return world_vectors(vectors, frame)
    assert places is not None
    turned: Floats = np.einsum("nij,nj->ni", enu_turns(places[:, 0], places[:, 1]), vectors)
    return turned


def _sigma(block: RowBlock, name: str, configured: float) -> Floats:
    """Standard deviations of rows, from the setting or from the device; NaN for those without one."""
    if configured:
        return np.full(len(block.times), configured)
    sigma = block.others[name][:, 0]
    return np.where(sigma > 0, sigma, np.nan)


def _covariance(sigmas: list[Floats]) -> Floats:
    """(n, 36), row by row, of independent standard deviations of the first axes."""
    covariance = np.zeros((len(sigmas[0]), AXIS_COUNT * AXIS_COUNT))
    for at, sigma in enumerate(sigmas):
        covariance[:, at * (AXIS_COUNT + 1)] = sigma**2
    return covariance


def _finite(*values: Floats) -> Mask:
    return np.asarray(np.isfinite(np.column_stack(values)).all(axis=1))
