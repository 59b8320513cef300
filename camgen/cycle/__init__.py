"""How long a program takes: feeds, acceleration, corners, joint speeds and waits (docs/cycle-time.md)."""
