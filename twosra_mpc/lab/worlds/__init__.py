"""Studies of worlds: which shapes of a grid pass them."""
