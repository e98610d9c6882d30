"""Generates scenarios that nobody owns: the data that the package comes with."""
