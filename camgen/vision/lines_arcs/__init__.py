"""From sub-pixel outlines to lines and arcs: runs, fits, joints, and one polish of the whole chain."""
