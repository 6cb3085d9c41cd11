"""Parameters of robots that are found from measurements."""
