"""Parameters of the equations of motion, found from logs of motions and torques."""
