"""Road users that are driven by rules or by the log."""
