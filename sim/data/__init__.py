"""Readers of logs, the packed store and the bank on the device."""
