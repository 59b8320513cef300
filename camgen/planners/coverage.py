"""What strokes cover, as a value that goes from the planner to summary and report."""

from __future__ import annotations

from msgspec import Struct

#: Below this share of covered copper the summary warns.
_ENOUGH = 0.98


class Coverage(Struct, frozen=True):
    """Areas, mm2. copper: what is to be covered. covered: of it, by ink. outside: ink beside it, of passes. thin: ink
    beside it that only centre lines leave, of tracks thinner than the tool.
    """

    copper: float
    covered: float
    outside: float
    thin: float

    @property
    def enough(self) -> bool:
        """Whether so little is bare that nobody need look."""
        return self.covered >= _ENOUGH * self.copper

    def percent(self, area: float) -> float:
        """``area``, mm2, as a share of the copper."""
        return 100 * area / self.copper if self.copper else 0.0

    def __str__(self) -> str:
        left = self.copper - self.covered
        return (
            f"{self.percent(self.covered):.2f} % of {self.copper:.1f} mm2 covered, {left:.2f} mm2 not; ink outside "
            f"{self.percent(self.outside):.2f} % ({self.outside:.2f} mm2), beside thin tracks "
            f"{self.percent(self.thin):.2f} % ({self.thin:.2f} mm2)"
        )
