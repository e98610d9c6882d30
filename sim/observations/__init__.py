"""What an agent sees of the world."""
