"""Networks from an embedding to a distribution over actions."""
