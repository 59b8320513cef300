"""Which pixels show the part."""
