"""What a reading had to leave out: counted by reason, the first of each with its place."""

from __future__ import annotations

_MOST_REASONS = 50


class LeftOut:
    """Counts what was left out; one line for each reason."""

    def __init__(self) -> None:
        self._found: dict[str, list[str | int]] = {}

    def note(self, what: str, where: str) -> None:
        """One more ``what`` ("a picture that is cut off"), at ``where``."""
        if what not in self._found and len(self._found) >= _MOST_REASONS:
            what = "others"
        entry = self._found.setdefault(what, [where, 0])
        entry[1] = int(entry[1]) + 1

    def clear(self) -> None:
        """Begin anew."""
        self._found.clear()

    def lines(self) -> list[str]:
        """One line for each reason, with the first place.

        >>> found = LeftOut()
        >>> found.note("a picture that is cut off", "7.jpg")
        >>> found.lines()
        ['a picture that is cut off, at 7.jpg']
        >>> found.note("a picture that is cut off", "9.jpg")
        >>> found.lines()
        ['a picture that is cut off: 2 times, the first at 7.jpg']
        """
        return [
            f"{what}: {count} times, the first at {where}"
            if int(count) > 1
            else f"{what}, at {where}"
            for what, (where, count) in self._found.items()
        ]
