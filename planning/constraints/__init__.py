"""What a motion or a configuration has to hold, as values: one kind of constraint a file."""
