"""Independent verification of plans: nothing here uses how they were made."""
