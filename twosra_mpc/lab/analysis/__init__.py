"""Explanations of plans: reasons, critical paths, and what other plans would cost."""
