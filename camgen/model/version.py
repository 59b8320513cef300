"""The version of camgen."""

__version__ = "0.1.0"
