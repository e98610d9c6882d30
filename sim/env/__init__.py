"""Environments and rollouts over the bank."""
