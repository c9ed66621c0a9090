"""The usual height of bodies by the place of their feet."""

from __future__ import annotations

SMALL, USUAL, LARGE, UNKNOWN = range(4)
SMALLEST, LARGEST = 0.6, 1.6
"""Heights between these, of the usual height at a place, are usual."""


class Heights:
    """The usual height of bodies by the place of their feet: a line through what both sources
    agree on, whose slope is held flat while little is known.
    """

    FLAT = 0.02
    """Worth of a flat line, in bodies times the picture's height squared."""
    FEWEST = 5.0

    def __init__(self, height: int) -> None:
        self._height = float(height)
        self._n = self._y = self._h = self._yy = self._yh = 0.0

    def learn(self, foot: float, height: float, weight: float) -> None:
        """Take in a body."""
        y, h = foot / self._height, height
        self._n += weight
        self._y += weight * y
        self._h += weight * h
        self._yy += weight * y * y
        self._yh += weight * y * h

    def size_of(self, foot: float, height: float) -> int:
        """`SMALL`, `USUAL` or `LARGE` for a body with its feet there; `UNKNOWN` while nothing is
        known.
        """
        if self._n < self.FEWEST:
            return UNKNOWN
        y, h = self._y / self._n, self._h / self._n
        spread = self._yy / self._n - y * y + self.FLAT
        slope = max(0.0, (self._yh / self._n - y * h) / spread)
        usual = max(0.3 * h, h + slope * (foot / self._height - y))
        share = height / usual
        return SMALL if share < SMALLEST else LARGE if share > LARGEST else USUAL
