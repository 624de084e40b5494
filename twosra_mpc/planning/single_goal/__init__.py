"""One goal: what the search must know of it, plans of one mode sequence, what is made of them."""
