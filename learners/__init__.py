"""Learners, the compiled program and its state."""
