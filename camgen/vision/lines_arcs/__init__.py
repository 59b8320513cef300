"""Converts sub-pixel outlines to lines and arcs: runs, fits, joints, and a fit of whole chains."""
