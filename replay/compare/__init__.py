"""What happens in one annotated log and not in another: a comparison of meanings, not of bytes."""

from replay.compare.difference import Comparison, Difference
from replay.compare.semantic import CompareOptions, compare

__all__ = ["CompareOptions", "Comparison", "Difference", "compare"]
