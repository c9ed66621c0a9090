"""Boxes in other people's files: one row reader for each format, the same for `record` and `eval`.

A reader gives rows as they stand in the file and holds each to the same rules (`check_box`). What
a row means is its user's affair: a recording leaves identities out, an evaluation needs them.
"""

from recorders.formats.boxes import MAX_FRAMES, BoxReader, BoxRow, check_box
from recorders.formats.caviar import CaviarReader
from recorders.formats.motchallenge import MotReader

__all__ = ["MAX_FRAMES", "BoxReader", "BoxRow", "CaviarReader", "MotReader", "check_box"]
