"""Experiments, one flat YAML file each."""
