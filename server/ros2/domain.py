"""The ROS domain of this machine's environment.

Source: ROS 2 documentation, "The ROS_DOMAIN_ID".
"""

from __future__ import annotations

import os

from imuscope.server.ros2.key_expressions import MAX_DOMAIN

VARIABLE = "ROS_DOMAIN_ID"


def usual_domain() -> int:
    """The domain where no setting names one: that of the environment, as for every node of ROS, else 0.

    Raises:
        ValueError: the variable is no domain; the text is for a person.
    """
    text = os.environ.get(VARIABLE, "").strip()
    if not text:
        return 0
    if not text.isdecimal() or int(text) > MAX_DOMAIN:
        raise ValueError(f"{VARIABLE} {text!r} of the environment is not a number from 0 to {MAX_DOMAIN}.")
    return int(text)
