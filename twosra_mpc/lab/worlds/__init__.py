"""Worlds: maps of ROS as obstacles, and which shapes of a grid pass."""
