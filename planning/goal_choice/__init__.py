"""The choice among configurations of a pose: costs, order, and the report of the choice."""
