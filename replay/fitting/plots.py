"""Histograms of the differences with their fits (PARTS, Figure 3). Needs matplotlib, imported
when asked for.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recorders.errors import SceneTraceError
from replay.export.output import whole_file
from replay.fitting.samples import FeatureSamples
from replay.trackers.parts.features import FEATURES, ONE
from replay.trackers.parts.regions import PARTS
from replay.trackers.parts.scoring import PartFeatures, density, split_models

BINS = 64
OTHERS = "other places, and boxes off the target, against what was learnt a second before"


def plot(
    samples: FeatureSamples, features: PartFeatures, out: Path, *, force: bool = False
) -> None:
    """A row per feature, a column per part: the matching case's histogram, the model over it, the
    rest in grey.

    Raises:
        SceneTraceError: matplotlib is not installed.
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SceneTraceError(
            "--plot needs matplotlib, which is not installed: pip install"
            " 'scenetrace[plot]', or matplotlib alone"
        ) from error
    figure = Figure(figsize=(14, 14), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(FEATURES), len(PARTS), squeeze=False)
    steps, others = samples.steps / ONE, samples.differences[~samples.matching] / ONE
    at = np.arange(0, ONE) / ONE
    for index, feature in enumerate(FEATURES):
        for j, words in enumerate(split_models(getattr(features, feature), feature)):
            ax, model = axes[index][j], density(words, at)
            ax.hist(
                others[:, j, index],
                bins=BINS,
                range=(0, 1),
                density=True,
                histtype="stepfilled",
                color="0.85",
                label=OTHERS,
            )
            tall, _, _ = ax.hist(
                steps[:, j, index], bins=BINS, range=(0, 1), density=True, histtype="stepfilled",
                color="tab:blue", alpha=0.7, label="the same target from frame to frame",
            )  # fmt: skip
            ax.plot(at, model, color="tab:red", lw=1.5, label="its model")
            # What is far off may lie in one bar, which would press the rest to the ground.
            ax.set_ylim(0, 1.1 * max(float(tall.max()), float(model.max()), 1e-3))
            kind, _, numbers = words.partition(" ")
            ax.set_title(
                f"{feature}, {PARTS[j].replace('_', ' ')}\n{kind}\n{numbers}", fontsize=6.5
            )
            ax.tick_params(labelsize=6)
    figure.suptitle("Absolute differences of features, by part", fontsize=10)
    figure.legend(
        *axes[0][0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        fontsize=9,
    )
    with whole_file(out, force=force) as file:
        figure.savefig(file.part, format=out.suffix.lstrip(".") or "png", dpi=110)
