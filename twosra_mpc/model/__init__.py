"""Kinematics of the agent, written once, symbolically (CasADi)."""
