"""DENSO PacScript and PAC (docs/languages/pacscript.md): the text and the machine, of which the strict read-back uses
the first.
"""
