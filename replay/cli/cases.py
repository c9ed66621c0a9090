"""A case of `scenetrace batch` where a log is expected."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError

if TYPE_CHECKING:
    from recorders.stores import Store


def log_or_case(word: str) -> Path | str:
    """A path, or a URI as it is: the type of an argument."""
    from recorders.stores import is_uri

    return word if is_uri(word) else Path(word)


def case_at(place: Path | str) -> Store | None:
    """The case at a folder or URI; None where there is a log, or nothing."""
    if isinstance(place, Path) and not place.is_dir():
        return None
    from reasoning.questions.catalogue import is_catalogue
    from recorders.stores import open_store

    if isinstance(place, Path):
        return open_store(place) if is_catalogue(place) else None
    return open_store(place)


def annotated_logs(case: Path) -> list[Path]:
    """The annotated logs of a local case.

    Raises:
        UsageError: it keeps none.
    """
    found = sorted((case / "annotated").glob("*.mcap"))
    if not found:
        raise UsageError(f"{case}: keeps no annotated logs (batch --keep tables)")
    return found
