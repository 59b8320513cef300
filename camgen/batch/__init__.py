"""Builds many parts, each as `camgen build` does, in several processes or on a cluster."""
