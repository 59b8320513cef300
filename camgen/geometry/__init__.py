"""Lines and arcs in the plane: intersections, distances, offsets. Vectorised over whole drawings."""
