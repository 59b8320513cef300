"""What is checked of a program before it is posted: reach, collisions, time, and what it amounts to."""
