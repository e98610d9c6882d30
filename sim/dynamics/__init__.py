"""How an action moves an object, and which action a move needs."""
