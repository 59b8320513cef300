"""Processing motions along the edges of a 3-D part: which edges, the poses along them, the joints that reach them."""
