"""Short tours: items that are run once each, entered at one of their ends and left at another."""
