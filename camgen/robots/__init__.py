"""Robots: models as data or from a URDF, kinematics both ways, postures."""
