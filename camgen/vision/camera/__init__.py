"""A camera: its lens, its files, and its calibration."""
