"""The tube around a reference that a tracked motion stays in."""
