"""Tours: many goals visited in the best order, every leg proved."""
