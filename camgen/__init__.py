"""camgen: checked robot and machine programs from drawings, photos and models."""

__version__ = "0.1.0"
