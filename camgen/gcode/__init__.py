"""An interpreter for G-code of any origin: text to motions of the tool centre, outputs and waits.

It follows LinuxCNC's RS-274 dialect with its parameters, expressions and O-words, of which other controllers' programs
use a part. What it does not know stops it with the line and the word; nothing is left out in silence.
"""
