"""DENSO PacScript and PAC (docs/languages/pacscript.md).

The strict read-back has the same text as the run of third-party programs, and its own machine.
"""
