"""Commands, configs, logs and tables."""
