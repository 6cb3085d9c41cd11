"""Tasks of several stages, planned as one."""
