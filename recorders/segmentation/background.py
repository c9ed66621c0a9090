"""The background in hindsight: each pixel's most common value over pictures sampled from the whole recording.

What stands still at the start and leaves later, or comes and stays, is foreground in every frame; the first frames
leave no ghosts.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from recorders.segmentation.segmenter import Image
from recorders.vision import cv2

MAX_SAMPLES = 60
MAX_SAMPLE_BYTES = 192 * 1024 * 1024


def sample(frames: Iterable[Image], most: int = MAX_SAMPLES, most_bytes: int = MAX_SAMPLE_BYTES) -> list[Image]:
    """Pictures spread evenly over a sequence of unknown length, in bounded memory.

    Every ``stride``-th picture is kept; when there are too many, every second one is dropped and the stride doubles.
    """
    kept: list[Image] = []
    stride = 1
    for index, frame in enumerate(frames):
        if index % stride:
            continue
        if kept and (len(kept) >= most or (len(kept) + 1) * frame.nbytes > max(most_bytes, 3 * frame.nbytes)):
            kept = kept[::2]
            stride *= 2
            if index % stride:
                continue
        kept.append(frame)
    return kept


def sort_stack(stack: list[Image]) -> list[Image]:
    """Sort each pixel's values over a stack, by Batcher's odd-even merge network of minima and maxima.

    Args:
        stack: n arrays of one shape, uint8.

    Returns:
        n arrays, the smallest value of each pixel first.
    """
    s = list(stack)
    n = len(s)
    p = 1
    while p < n:
        k = p
        while k >= 1:
            for j in range(k % p, n - k, 2 * k):
                for i in range(min(k, n - j - k)):
                    if (i + j) // (2 * p) == (i + j + k) // (2 * p):
                        a, b = s[i + j], s[i + j + k]
                        s[i + j], s[i + j + k] = cv2.min(a, b), cv2.max(a, b)
            k //= 2
        p *= 2
    return s


def most_common(stack: list[Image]) -> tuple[Image, Image]:
    """Each pixel's background and its spread: centre and half width of the shortest interval with half the values.

    The shortest half (least median of squares) withstands up to half of the samples showing something else.
    Equally short intervals: the one of the smallest values.

    Returns:
        Two arrays of the stack's shape, uint8.
    """
    s = sort_stack(stack)
    m = len(s) // 2
    best = cv2.subtract(s[m], s[0])
    twice = cv2.addWeighted(s[m], 0.5, s[0], 0.5, 0)
    for i in range(1, len(s) - m):
        width = cv2.subtract(s[i + m], s[i])
        shorter = cv2.compare(width, best, cv2.CMP_LT)
        best = cv2.min(width, best)
        cv2.copyTo(cv2.addWeighted(s[i + m], 0.5, s[i], 0.5, 0), shorter, twice)
    return twice, best
