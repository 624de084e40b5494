"""Worlds: maps of ROS as obstacles."""
