"""The serial chain as a value, Denavit-Hartenberg tables, and joints that mimic others."""
