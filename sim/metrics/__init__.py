"""What is measured of each object at each step."""
