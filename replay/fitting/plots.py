"""Histograms of the differences with their fits (PARTS, Figure 3). Needs matplotlib, imported when asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recorders.errors import SceneTraceError
from replay.export.output import whole
from replay.fitting.samples import Samples
from replay.trackers.parts.features import FEATURES, ONE
from replay.trackers.parts.regions import PARTS
from replay.trackers.parts.scoring import PartFeatures, density, split_models


def plot(samples: Samples, features: PartFeatures, out: Path, *, force: bool = False) -> None:
    """A row per feature, a column per part: the matching case's histogram, the model over it, the rest in grey.

    Raises:
        SceneTraceError: matplotlib is not installed.
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as e:
        raise SceneTraceError(
            "--plot needs matplotlib, which is not installed: pip install 'scenetrace[plot]', or matplotlib alone"
        ) from e
    figure = Figure(figsize=(14, 14), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(FEATURES), len(PARTS), squeeze=False)
    steps, others = samples.steps / ONE, samples.differences[~samples.matching] / ONE
    at = np.arange(0, ONE) / ONE
    for i, feature in enumerate(FEATURES):
        for j, words in enumerate(split_models(getattr(features, feature), feature)):
            ax = axes[i][j]
            ax.hist(others[:, j, i], bins=64, range=(0, 1), density=True, color="0.85", label="others")
            ax.hist(steps[:, j, i], bins=64, range=(0, 1), density=True, color="tab:blue", alpha=0.7)
            ax.plot(at, density(words, at), color="tab:red", lw=1.5)
            ax.set_title(f"{feature}, {PARTS[j].replace('_', ' ')}\n{words}", fontsize=7)
            ax.tick_params(labelsize=6)
    figure.suptitle(
        "Absolute differences from frame to frame: the same target (blue, with its model) and others", fontsize=10
    )
    with whole(out, force=force) as file:
        figure.savefig(file.part, format=out.suffix.lstrip(".") or "png", dpi=110)
