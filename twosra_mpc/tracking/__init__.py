"""Tracking a plan: linear time-varying model predictive control, one phase at a time."""
