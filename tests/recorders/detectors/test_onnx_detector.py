"""Models in files: what they say of themselves, that they run, and what is said of bad ones."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders.detectors import DetectorParameters, ModelOptions, OnnxDetector, network
from recorders.detectors.model_file import read_model
from recorders.detectors.network import OnnxRuntimeNetwork
from recorders.errors import SceneTraceError, UsageError

F = np.float32
CELLS = 144 + 36 + 9
PICTURE = np.zeros((48, 96, 3), np.uint8)  # lies in rows 24 to 72 of a letterbox of 96x96


def opened(
    path: Path, family: str | None = None, labels: tuple[str, ...] = (), **parameters: Any
) -> OnnxDetector | None:
    return OnnxDetector(
        ModelOptions(path, family, labels), DetectorParameters(**parameters)
    )


def test_a_yolo_runs_in_opencv_and_its_boxes_are_the_pictures(
    constant_model: Callable[..., Any], tmp_path: Path
) -> None:
    out = np.zeros((1, 6, CELLS), F)
    out[0, :, 3] = [48, 48, 20, 10, 0.2, 0.9]
    out[0, :, 4] = [49, 48, 20, 10, 0.1, 0.8]
    out[0, :, 5] = [49, 48, 20, 10, 0.7, 0.1]
    names = {"names": "{0: 'person', 1: 'car'}", "task": "detect"}
    path = constant_model(
        tmp_path / "y.onnx", {"output0": out}, (1, 3, 96, 96), metadata=names
    )
    detector = opened(path)
    found = detector.detect(PICTURE)
    assert [s.label for s in found] == ["car", "person"]
    assert found[0].box == pytest.approx((38, 19, 20, 10))
    assert found[0].score == pytest.approx(0.9)
    assert detector.facts["format"] == "yolov8"
    assert detector.facts["engine"].startswith("opencv")
    assert detector.facts["sha256"] == read_model(path).sha256
    assert [s.label for s in opened(path, labels=("person",)).detect(PICTURE)] == ["person"]
    assert opened(path, min_score=0.95).detect(PICTURE) == []
    assert len(opened(path, suppress_overlap=1.0).detect(PICTURE)) == 3


def test_open_sizes_come_from_the_metadata_or_the_parameter(
    constant_model: Callable[..., Any], tmp_path: Path
) -> None:
    out = {"output0": np.zeros((1, 300, 6), F)}
    open_ = (1, 3, "h", "w")
    told = constant_model(tmp_path / "a.onnx", out, open_, metadata={"imgsz": "[64, 96]"})
    untold = constant_model(tmp_path / "b.onnx", out, open_)
    assert opened(told).facts["input"] == "96x64 letterbox"
    assert opened(untold).facts["input"] == "640x640 letterbox"
    assert opened(untold, input_side=128).facts["input"] == "128x128 letterbox"


@pytest.mark.parametrize("engine", ["opencv", "onnxruntime"])
def test_dfine_with_its_second_input(
    constant_model: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    engine: str,
) -> None:
    boxes = np.zeros((1, 300, 4), F)
    boxes[0, 0] = [48, 48, 96, 96]
    scores = np.zeros((1, 300), F)
    scores[0, 0] = 0.75
    outputs = {"labels": np.full((1, 300), 2, np.int64), "boxes": boxes, "scores": scores}
    path = constant_model(tmp_path / "d.onnx", outputs, (1, 3, 96, 96), sizes=True)
    if engine == "onnxruntime":
        pytest.importorskip("onnxruntime")
        monkeypatch.setattr(network, "ENGINES", {"onnxruntime": OnnxRuntimeNetwork})
    detector = opened(path)
    (found,) = detector.detect(PICTURE)
    assert detector.facts["engine"].startswith(engine)
    assert (detector.facts["format"], found.label) == ("detr", "car")
    assert found.box == pytest.approx((48, 24, 48, 24))


@pytest.mark.parametrize(
    ("outputs", "picture", "kind", "family"),
    [
        ({"o": (1, 3 * CELLS, 8)}, (1, 3, 96, 96), 10, "yolov5"),
        ({"o": (1, CELLS, 8)}, (1, 3, 96, 96), 1, "yolox"),
        ({"dets": (1, 300, 4), "labels": (1, 300, 91)}, (1, 3, 96, 96), 1, "rfdetr"),
        ({"o": (1, 85, 6, 6)}, (1, 3, 96, 96), 1, "fastestdet"),
        ({"o": (1, CELLS + 4, 112)}, (1, 3, 96, 96), 1, "nanodet"),
        ({"o": (1, 1, 100, 7)}, (1, 3, 96, 96), 1, "ssd"),
        (
            {
                "detection_boxes": (1, 10, 4),
                "detection_scores": (1, 10),
                "detection_classes": (1, 10),
            },
            (1, 96, 96, 3),
            2,
            "ssd",
        ),
    ],
)
def test_every_family_runs_in_opencv(
    constant_model: Callable[..., Any],
    tmp_path: Path,
    outputs: dict[str, tuple[int, ...]],
    picture: tuple[int, int, int, int],
    kind: int,
    family: str,
) -> None:
    values = {name: np.zeros(shape, F) for name, shape in outputs.items()}
    detector = opened(constant_model(tmp_path / "m.onnx", values, picture, kind=kind))
    assert detector.facts["format"] == family
    assert detector.facts["engine"].startswith("opencv")
    detector.detect(PICTURE)


def test_a_model_that_fits_nothing_names_its_outputs(
    constant_model: Callable[..., Any], tmp_path: Path
) -> None:
    path = constant_model(
        tmp_path / "c.onnx", {"classes": np.zeros((1, 1000), F)}, (1, 3, 96, 96)
    )
    with pytest.raises(SceneTraceError, match=r"fit no known detector.*classes 1x1000"):
        opened(path)
    with pytest.raises(SceneTraceError, match=r"do not fit the format yolov8"):
        opened(path, "yolo11")


def test_words_that_are_wrong(constant_model: Callable[..., Any], tmp_path: Path) -> None:
    out = {"output0": np.zeros((1, 84, CELLS), F)}
    path = constant_model(tmp_path / "m.onnx", out, (1, 3, 96, 96))
    with pytest.raises(UsageError, match=r"--labels persn: m.onnx knows no such class"):
        opened(path, labels=("persn",))
    with pytest.raises(UsageError, match=r"--model-format yolo: must be one of yolov5"):
        opened(path, "yolo")


@pytest.mark.parametrize(
    ("picture", "said"),
    [
        ((4, 3, 96, 96), "takes 4 pictures at once"),
        ((1, 3, 96, 5000), "wants pictures of 5000x96, over 4096"),
        ((1, 1, 96, 96), r"no input takes one colour picture .* images 1x1x96x96"),
    ],
)
def test_inputs_that_are_refused(
    constant_model: Callable[..., Any],
    tmp_path: Path,
    picture: tuple[int, int, int, int],
    said: str,
) -> None:
    path = constant_model(tmp_path / "m.onnx", {"o": np.zeros((1, 300, 6), F)}, picture)
    with pytest.raises(SceneTraceError, match=said) as refused:
        opened(path)
    assert "\n" not in str(refused.value)


def test_damaged_files_are_one_line(
    constant_model: Callable[..., Any], tmp_path: Path
) -> None:
    whole = constant_model(
        tmp_path / "m.onnx", {"o": np.zeros((1, 300, 6), F)}, (1, 3, 96, 96)
    ).read_bytes()
    broken = tmp_path / "broken.onnx"
    rng = np.random.default_rng(1)
    cases = [b"", b"\x00" * 99, whole[: len(whole) // 2], b"<html>no model</html>"]
    for _ in range(6):
        changed = bytearray(whole)
        for place in rng.integers(0, len(whole), 4).tolist():
            changed[place] = int(rng.integers(0, 256))
        cases.append(bytes(changed))
    for data in cases:
        broken.write_bytes(data)
        with suppress(SceneTraceError):  # anything else fails the test
            opened(broken).detect(PICTURE)
    for data in cases[:4]:
        broken.write_bytes(data)
        with pytest.raises(SceneTraceError, match=r"broken.onnx: not an ONNX model") as e:
            opened(broken)
        assert "\n" not in str(e.value)
    with pytest.raises(SceneTraceError, match="cannot be read"):
        read_model(tmp_path / "absent.onnx")


def test_a_model_that_brings_the_libraries_down_is_one_line(
    constant_model: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fall = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    monkeypatch.setattr(network, "_CHILD", fall)
    path = constant_model(tmp_path / "m.onnx", {"o": np.zeros((1, 300, 6), F)})
    with pytest.raises(
        SceneTraceError, match=r"OpenCV: it brings the library down \(signal 11"
    ):
        opened(path)


def test_what_nothing_can_run_says_so(
    constant_model: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    onnx = pytest.importorskip("onnx")
    path = constant_model(
        tmp_path / "m.onnx", {"o": np.zeros((1, 300, 6), F)}, (1, 3, 96, 96)
    )
    model = onnx.load(path)
    model.graph.node[0].op_type = "Fantasy"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(SceneTraceError, match=r"cannot be run \(OpenCV: .*onnxruntime: "):
        opened(path)
    monkeypatch.setattr(network, "find_spec", lambda _: None)
    with pytest.raises(SceneTraceError, match=r"pip install 'scenetrace\[onnx\]'"):
        opened(path)


def test_onnxruntime_gives_what_opencv_gives(
    constant_model: Callable[..., Any], tmp_path: Path
) -> None:
    pytest.importorskip("onnxruntime")
    out = np.linspace(0, 1, 1800, dtype=F).reshape(1, 300, 6)
    path = constant_model(tmp_path / "m.onnx", {"o": out}, (1, 3, 96, 96))
    made = OnnxRuntimeNetwork(read_model(path))
    ((name, value),) = made.run({"images": np.zeros((1, 3, 96, 96), F)})
    assert name == "o"
    np.testing.assert_array_equal(value, out)
