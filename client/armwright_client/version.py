"""The version of this library."""

VERSION = "0.4.0"
