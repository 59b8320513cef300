"""Kinematics of arms: forward and inverse, limits, singularities, and joint values along paths."""
