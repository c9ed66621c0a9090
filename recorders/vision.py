"""OpenCV as scenetrace uses it: imported in one place, with the switches that make it the same on
every machine.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

# IPP picks its kernels by the processor at hand; it must be off before the library is loaded.
# Only the benchmark that measures whether it would matter (tests/benchmarks/bench_trust.py)
# leaves it on.
if os.environ.get("SCENETRACE_EXPERIMENT") == "ipp":
    os.environ.pop("OPENCV_IPP", None)
else:
    os.environ["OPENCV_IPP"] = "disabled"
os.environ.setdefault(
    "OPENCV_LOG_LEVEL", "ERROR"
)  # or the library warns of that on every start

import cv2

cv2.ocl.setUseOpenCL(False)

__all__ = ["cv2", "opencv_threads"]


@contextmanager
def opencv_threads(count: int) -> Iterator[None]:
    """Let OpenCV use so many threads of its own for a while; results do not depend on it."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
