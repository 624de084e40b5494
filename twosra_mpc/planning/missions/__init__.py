"""Missions: several goals, objects to hold and to carry, as one plan."""
