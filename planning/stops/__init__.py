"""Stops of a motion: along its own path, and with every joint braking by itself."""
