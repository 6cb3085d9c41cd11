"""From a problem to a certified, timed trajectory."""
