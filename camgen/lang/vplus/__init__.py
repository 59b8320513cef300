"""Adept V+ (docs/languages/vplus.md): the text, the expressions and the machine."""
