"""The colour of a track, one for all that draws: Foxglove's annotations, video, pictures, report."""

from __future__ import annotations

_TRACKS = (
    (0.12, 0.47, 0.71),
    (1.00, 0.50, 0.05),
    (0.17, 0.63, 0.17),
    (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74),
    (0.09, 0.75, 0.81),
    (0.89, 0.47, 0.76),
    (0.74, 0.74, 0.13),
)
COLOUR_COUNT = len(_TRACKS)
"""After so many identities the colours begin anew."""

Colour = tuple[int, int, int]


def track_colour(identity: int) -> tuple[float, float, float]:
    """Red, green and blue from 0 to 1: a function of the identity alone."""
    return _TRACKS[identity % COLOUR_COUNT]


def luminance(red: float, green: float, blue: float) -> float:
    """Relative luminance of an sRGB colour, 0 to 1 (WCAG 2.2)."""
    linear = [
        v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
        for v in (red, green, blue)
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def letter_colour(identity: int) -> tuple[float, float, float]:
    """Black or white, whichever can be read better on the track's colour: a contrast of 4.5 to 1
    at least.

    >>> letter_colour(0), letter_colour(7)
    ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    """
    ground = luminance(*track_colour(identity))
    # Contrast with white is 1.05 over, with black what is over 0.05 (WCAG 2.2): equal here.
    value = 1.0 if (ground + 0.05) ** 2 < 1.05 * 0.05 else 0.0
    return value, value, value


def track_bgr(identity: int) -> Colour:
    """Blue, green and red from 0 to 255, as OpenCV wants them.

    >>> track_bgr(1), track_bgr(9)
    ((13, 128, 255), (13, 128, 255))
    """
    red, green, blue = track_colour(identity)
    return round(255 * blue), round(255 * green), round(255 * red)


def track_css(identity: int) -> str:
    """The colour as CSS writes it.

    >>> track_css(1)
    'rgb(255,128,13)'
    """
    blue, green, red = track_bgr(identity)
    return f"rgb({red},{green},{blue})"
