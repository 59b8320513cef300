"""Numbers that only look random: the same seed gives the same ones on every machine and with every library.

SplitMix64's mixing of a counter (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014), cut
to 32 bits so that plain Python, numpy and compiled code agree without overflow.
"""

from __future__ import annotations

__all__ = ["Dice"]

_MASK = 0xFFFFFFFF


class Dice:
    """A stream of whole numbers. seed: 0 or more; equal seeds give equal streams."""

    def __init__(self, seed: int) -> None:
        self.state = (seed * 0x9E3779B1 + 0x7F4A7C15) & _MASK

    def below(self, bound: int) -> int:
        """The next number, 0 to ``bound`` - 1."""
        self.state = (self.state + 0x9E3779B9) & _MASK
        word = self.state
        word = ((word ^ (word >> 16)) * 0x85EBCA6B) & _MASK
        word = ((word ^ (word >> 13)) * 0xC2B2AE35) & _MASK
        return (word ^ (word >> 16)) % bound
