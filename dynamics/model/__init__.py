"""Bodies of a chain for the dynamics, and changes of them: motors, loads."""
