"""Boards and sheets whose corners are known in mm: drawn, and found in photos."""
