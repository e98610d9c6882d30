"""Pictures of scenarios and rollouts."""
