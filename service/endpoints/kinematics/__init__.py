"""Forward kinematics and Jacobians of a robot, and conversion of poses."""
