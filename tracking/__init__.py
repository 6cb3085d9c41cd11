"""Controllers and their closed-loop simulation along a trajectory."""
