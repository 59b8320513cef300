"""Planners: a Part to ToolPaths. One function per file."""
