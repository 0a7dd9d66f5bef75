"""ROS 2 over Zenoh, as rmw_zenoh defines it: names on the wire, attachments, types. No ROS installation is needed."""
