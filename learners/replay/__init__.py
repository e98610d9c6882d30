"""Remembers transitions on the device, to learn from them again."""
