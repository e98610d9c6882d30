"""Drivetrain: reinforcement learning for driving with the simulator in the program."""
