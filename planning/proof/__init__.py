"""The proof of a timed motion, independent of the planners."""
