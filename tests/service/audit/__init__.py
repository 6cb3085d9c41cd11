"""Tests of the second look at certified motions."""
