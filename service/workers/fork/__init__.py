"""The fork server, which loads what workers need once, and how the server talks to it."""
