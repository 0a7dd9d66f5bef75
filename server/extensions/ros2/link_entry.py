"""Entry point of the link to ROS 2: registers it where its packages are installed."""

from imuscope.recordings.optional_packages import lacks
from imuscope.server.extensions.ros2 import EXTENSION

if not lacks(*EXTENSION.modules):
    from imuscope.server.extensions.ros2 import link  # noqa: F401 (registers it)
