"""Readers of point clouds, one module a kind of file. Each gives a `FileCloud`."""
