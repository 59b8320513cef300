"""Read-backs: one interpreter of a controller language each, written from its manual."""
