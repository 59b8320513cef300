"""3-D parts: a mesh or exact CAD in, triangles and sharp edges with both face normals out."""
