"""Lines and arcs in the plane and in space, many at once: the geometry that every stage shares."""
