"""Laws of time along a path that keep every limit."""
