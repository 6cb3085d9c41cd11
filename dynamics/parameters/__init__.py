"""The equations of motion, linear in the parameters of the bodies."""
