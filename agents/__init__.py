"""Policies: encoders, heads and what joins them."""
