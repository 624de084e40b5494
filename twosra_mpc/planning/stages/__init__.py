"""Stages placed in the world: variants of touches and orders, and what the search must know."""
