"""Bridge from MoveIt's planning interface in ROS 2 to an Armwright service."""
