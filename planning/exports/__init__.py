"""Programs and messages for robot controllers, each with a proof of its own."""
