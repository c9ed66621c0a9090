"""What is closed at the end of a ``with``."""

from __future__ import annotations

from typing import Self


class Closing:
    """A reader that a ``with`` closes, whether it ends well or not."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of what is open."""
        raise NotImplementedError
