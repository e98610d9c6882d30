"""Networks from an observation to an embedding."""
