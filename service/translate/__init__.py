"""Wire documents to domain values and back."""
