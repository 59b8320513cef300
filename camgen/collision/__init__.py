"""Collision: a robot and its tool as cuboids against one another, fixtures, table and part, many poses at once."""
