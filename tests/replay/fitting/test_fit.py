"""Models fitted to numbers drawn from known ones; the fit command end to end."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from fixtures.logs import write_scene_log, write_truth
from fixtures.scenes import generate
from recorders.errors import SceneTraceError
from replay.cli import main
from replay.configuration import replay_config
from replay.fitting import collect, fit
from replay.fitting.fit import half_normal, mixture, model_of, unimodal


def test_a_half_normal_is_found_again() -> None:
    d = np.abs(np.random.default_rng(1).normal(0, 0.12, 20000))
    assert unimodal(d)
    assert float(half_normal(d).split()[1]) == pytest.approx(0.12, abs=0.004)
    assert model_of(d).startswith("half-normal")


def test_two_modes_get_a_mixture_of_those_two() -> None:
    rng = np.random.default_rng(2)
    d = np.clip(np.concatenate([rng.normal(0.1, 0.03, 6000), rng.normal(0.6, 0.05, 2000)]), 0, 1)
    assert not unimodal(d)
    w1, m1, s1, w2, m2, s2 = (float(v) for v in mixture(d).split()[1:])
    assert (w1, m1, s1) == (pytest.approx(0.75, abs=0.02), pytest.approx(0.1, abs=0.01), pytest.approx(0.03, abs=0.01))
    assert (w2, m2, s2) == (pytest.approx(0.25, abs=0.02), pytest.approx(0.6, abs=0.01), pytest.approx(0.05, abs=0.01))


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("fit")
    scene = generate("demo", seed=1, size=(320, 240), frames=120)
    return write_scene_log(scene, folder / "scene.mcap"), write_truth(scene, folder / "gt.txt")


def test_the_command_writes_a_configuration_that_says_what_it_was_fitted_on(
    annotated: tuple[Path, Path], tmp_path: Path
) -> None:
    scene, truth = annotated
    out, plot = tmp_path / "features.toml", tmp_path / "features.png"
    words = ["fit", str(scene), "--truth", str(truth), "-o", str(out), "--plot", str(plot)]
    assert main(words) == 0
    found = tomllib.loads(out.read_text())["part_features"]
    assert found["fitted_on"].startswith("scene.mcap with gt.txt (")
    for weights in ("omega", "gamma"):
        assert sum(v for k, v in found.items() if k.startswith(weights)) == pytest.approx(1.0, abs=0.01)
    assert replay_config("parts", out)["part_features"].fitted_on == found["fitted_on"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert main(words) == 1, "nothing is overwritten"
    assert main([*words, "--truth", str(truth), "--force"]) == 2


def test_the_same_recordings_give_the_same_fit_and_weights_help(annotated: tuple[Path, Path]) -> None:
    samples = collect([annotated])
    first, second = fit(samples), fit(collect([annotated]))
    assert first == second
    assert first.accuracy >= first.before


def test_a_recording_without_pixels_is_refused(tmp_path: Path) -> None:
    scene = generate("pass_by", size=(160, 120), frames=40)
    log = write_scene_log(scene, tmp_path / "boxes.mcap", pictures="none", masks=False)
    with pytest.raises(SceneTraceError, match="no pictures or no foreground masks"):
        collect([(log, write_truth(scene, tmp_path / "gt.txt"))])
