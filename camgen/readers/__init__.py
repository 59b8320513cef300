"""Readers: a file's bytes to a Part, with notes on all that was skipped, mended or assumed."""
