"""What the recording says of its tracks once it is over: fragments joined, gaps filled, paths
smoothed.
"""

from __future__ import annotations

from recorders.parameters import Parameters
from replay.hindsight.parameters import HindsightParameters
from replay.hindsight.rewrite import rewrite

SECTIONS: dict[str, type[Parameters]] = {"hindsight": HindsightParameters}

__all__ = ["SECTIONS", "HindsightParameters", "rewrite"]
