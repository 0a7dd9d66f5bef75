"""ROS 2 over Zenoh, as rmw_zenoh defines it: names on the wire, attachments, types. No ROS installation is needed."""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "ros2",
    "ROS 2",
    modules=("zenoh", "xxhash"),
    extra="ros2",
    parts="imuscope.server.extensions.ros2.service",
    routes=("imuscope.server.extensions.ros2.routes",),
    diagnoses="imuscope.server.extensions.ros2.diagnosis:findings",
)
