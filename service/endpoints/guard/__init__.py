"""The gate for motions that others make: at once, and in sessions over a WebSocket."""
