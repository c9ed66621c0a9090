"""What of the machine can change a result: interpreter, processor kernels, OpenCV's build. Every
log says it.
"""

from __future__ import annotations

import platform
import sys

from recorders.vision import cv2

_BUILD_FACTS = (
    "Version control",
    "CPU/HW features",
    "Baseline",
    "JPEG",
    "PNG",
    "Intel IPP",
    "Parallel framework",
)


def python_version() -> str:
    """Interpreter and version: results were found equal over versions, so it is recorded and not
    part of a fingerprint.
    """
    return f"{platform.python_implementation()} {platform.python_version()}"


def machine() -> str:
    """The processor's architecture, and the kernels that numpy picks for it: exp, log and arctan2
    differ over them.
    """
    # numpy tells it by printing alone (`numpy.show_runtime`); without this module the
    # architecture has to do.
    numpy_core = sys.modules.get("numpy._core._multiarray_umath")
    here = getattr(numpy_core, "__cpu_features__", {})
    kernels = [
        name for name in getattr(numpy_core, "__cpu_dispatch__", ()) if here.get(name)
    ]
    return f"{platform.machine()}, numpy with {' '.join(kernels) or 'its baseline alone'}"


def opencv_build() -> str:
    """The lines of OpenCV's build information that say which kernels it may pick."""
    lines = []
    for line in cv2.getBuildInformation().splitlines():
        key, _, value = line.strip().partition(":")
        if key in _BUILD_FACTS and value.strip():
            lines.append(f"{key}: {' '.join(value.split())}")
    lines.append(f"IPP in use: {'yes' if cv2.ipp.useIPP() else 'no'}")
    return "; ".join(lines)
