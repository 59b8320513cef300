"""The motion of an arm between two poses: pose paths, joint paths, limits, detours and corners."""
