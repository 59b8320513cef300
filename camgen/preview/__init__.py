"""What a build made, to look at: one view as a value, and the page, the pictures and the drawings of it."""
