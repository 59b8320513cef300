"""Collision tests of a robot and its tool against each other, fixtures, table and part."""
