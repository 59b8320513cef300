"""Robots: models as data, kinematics both ways, postures, and the joints along a whole path."""
