"""How fast the simulator is, beside the published figures."""
