"""How a recording's pictures are looked through: the words of ``--detect``, and what they stand
for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from recorders import plugins
from recorders.detectors import Detector, DetectorParameters, ModelOptions, OnnxDetector
from recorders.errors import SceneTraceError, UsageError
from recorders.parameters import Config
from recorders.segmentation import SEGMENTERS

NO_DETECTION = "none"
ONNX = "onnx"


@dataclass(frozen=True)
class Methods:
    """What is done with the pictures.

    Attributes:
        segment: a name of `SEGMENTERS`, for masks; None: no masks.
        detect: ``onnx``, an entry point of the group ``scenetrace.detectors``, or
            ``module:Class``; None: no detector.
    """

    segment: str | None = None
    detect: str | None = None

    def __str__(self) -> str:
        return ",".join(filter(None, (self.segment, self.detect))) or NO_DETECTION


def methods_of(text: str, model: ModelOptions | None = None) -> Methods:
    """The methods of the words of ``--detect``: ``motion``, ``onnx``, ``motion,onnx``, ``none``.

    Raises:
        UsageError: there is no such method, there are two of one kind, or the model belongs to
            none of them.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    masks = [word for word in words if word in SEGMENTERS]
    others = [word for word in words if word not in SEGMENTERS and word != NO_DETECTION]
    if not words or (NO_DETECTION in words and len(words) > 1):
        raise UsageError(f"--detect {text}: {NO_DETECTION} goes with nothing else")
    for several, what in ((masks, "one way to masks"), (others, "one detector")):
        if len(several) > 1:
            raise UsageError(f"--detect {text}: {what} at a time")
    known = plugins.names(plugins.DETECTORS)
    for word in others:
        if word != ONNX and ":" not in word and word not in known:
            told = ", ".join([*SEGMENTERS, ONNX, *known, NO_DETECTION])
            raise UsageError(f"--detect {word}: must be one of {told}, or module:Class")
    if others == [ONNX] and model is None:
        raise UsageError("--detect onnx needs --model FILE.onnx")
    if others != [ONNX] and model is not None:
        raise UsageError(f"--model {model.path} goes with --detect onnx")
    return Methods(*(several[0] if several else None for several in (masks, others)))


def open_detector(
    name: str, model: ModelOptions | None, config: Config
) -> tuple[Detector, dict[str, str]]:
    """A detector, and what a log says of it.

    Raises:
        UsageError: there is no such detector, or it has no method `detect`.
        SceneTraceError: it cannot be loaded.
    """
    if name == ONNX:
        assert model is not None
        parameters = config.get("detector", DetectorParameters())
        assert isinstance(parameters, DetectorParameters)
        network = OnnxDetector(model, parameters)
        return network, network.facts
    found = plugins.load(plugins.DETECTORS, name, _own())
    try:
        made = found.value()
    except Exception as error:
        raise SceneTraceError(
            f"the detector {name}: {type(error).__name__}: {error}"
        ) from error
    if not isinstance(made, Detector):
        raise UsageError(f"the detector {name}: has no method detect(image)")
    return made, {"class": name, "version": found.version}


def _own() -> Sequence[str]:
    return [ONNX]
