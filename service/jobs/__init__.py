"""Jobs: stored requests that are answered later, and batches of them."""
