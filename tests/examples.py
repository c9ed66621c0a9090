"""How many examples a property test draws: a fifth of them in each run, all of them in
`python tests --all`. The examples differ from run to run, so that many runs try what one does not.
"""

from __future__ import annotations

import os

ALL = "SCENETRACE_ALL_EXAMPLES"
"""Set to 1 by `python tests --all`."""
SHARE = 5
FEWEST = 5


def examples(most: int) -> int:
    """So many examples, or the share of them that a plain run draws."""
    if os.environ.get(ALL) == "1":
        return most
    return min(most, max(FEWEST, most // SHARE))
