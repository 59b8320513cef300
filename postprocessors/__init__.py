"""Post-processors: one controller each."""
