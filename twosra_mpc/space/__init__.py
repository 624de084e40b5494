"""The robot among obstacles: its footprint, what is free for it, drives proved clear of them."""
