"""What the wire may say: strict models, one noun a file."""
