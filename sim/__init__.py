"""The simulator: scenarios, worlds, metrics and observations."""
