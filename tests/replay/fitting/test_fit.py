"""Models fitted to numbers drawn from known ones; the fit command end to end."""

from __future__ import annotations

import tomllib
from dataclasses import replace
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
from replay.fitting.samples import FeatureSamples


def test_a_half_normal_is_found_again() -> None:
    d = np.abs(np.random.default_rng(1).normal(0, 0.12, 20000))
    assert unimodal(d)
    assert float(half_normal(d).split()[1]) == pytest.approx(0.12, abs=0.004)
    assert model_of(d).startswith("half-normal")


def test_two_modes_get_a_mixture_of_those_two() -> None:
    rng = np.random.default_rng(2)
    d = np.clip(
        np.concatenate([rng.normal(0.1, 0.03, 6000), rng.normal(0.6, 0.05, 2000)]), 0, 1
    )
    assert not unimodal(d)
    w1, m1, s1, w2, m2, s2 = (float(v) for v in mixture(d).split()[1:])
    assert (w1, m1, s1) == (
        pytest.approx(0.75, abs=0.02),
        pytest.approx(0.1, abs=0.01),
        pytest.approx(0.03, abs=0.01),
    )
    assert (w2, m2, s2) == (
        pytest.approx(0.25, abs=0.02),
        pytest.approx(0.6, abs=0.01),
        pytest.approx(0.05, abs=0.01),
    )


def test_every_truth_has_the_size_that_it_was_labelled_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, truths = [], []
    for seed in (1, 2):
        scene = generate("demo", seed=seed, size=(240, 180), frames=40)
        logs.append(write_scene_log(scene, tmp_path / f"{seed}.mcap"))
        truths.append(write_truth(scene, tmp_path / f"{seed}.txt"))
    rows = [line.split(",") for line in truths[1].read_text().splitlines()]
    larger = [[*r[:2], *(f"{1.6 * float(v):.2f}" for v in r[2:6]), *r[6:]] for r in rows]
    truths[1].write_text("".join(",".join(r) + "\n" for r in larger))
    pairs = list(zip(logs, truths, strict=True))
    mixed = collect(pairs, [None, (384, 288)])
    one, other = collect([pairs[0]]), collect([pairs[1]], [(384, 288)])
    assert len(mixed.steps) == len(one.steps) + len(other.steps)
    words = ["fit", *map(str, logs), "-o", str(tmp_path / "f.toml")]
    words += [w for truth in truths for w in ("--truth", str(truth))]
    assert main([*words, "--truth-size", "384x288"]) == 2
    assert "2 --truth but 1 --truth-size" in capsys.readouterr().err
    assert main([*words, "--truth-size", "same", "--truth-size", "384x288"]) == 0


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("fit")
    scene = generate("demo", seed=1, size=(320, 240), frames=120)
    return write_scene_log(scene, folder / "scene.mcap"), write_truth(
        scene, folder / "gt.txt"
    )


@pytest.fixture(scope="module")
def samples(annotated: tuple[Path, Path]) -> FeatureSamples:
    return collect([annotated])


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
        assert sum(v for k, v in found.items() if k.startswith(weights)) == pytest.approx(
            1.0, abs=0.01
        )
    assert (
        vars(replay_config("parts", out)["part_features"])["fitted_on"]
        == found["fitted_on"]
    )
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert main(words) == 1, "nothing is overwritten"
    assert main([*words, "--truth", str(truth), "--force"]) == 2


def test_the_same_recordings_give_the_same_fit_and_weights_help(
    annotated: tuple[Path, Path], samples: FeatureSamples
) -> None:
    first, second = fit(samples), fit(collect([annotated]))
    assert first == second
    assert first.accuracy is not None
    assert first.before is not None
    assert first.chance < first.before <= first.accuracy + 0.1


def test_a_recording_without_pixels_is_refused(tmp_path: Path) -> None:
    scene = generate("pass_by", size=(160, 120), frames=40)
    log = write_scene_log(scene, tmp_path / "boxes.mcap", pictures="none", masks=False)
    with pytest.raises(SceneTraceError, match="no pictures or no foreground masks"):
        collect([(log, write_truth(scene, tmp_path / "gt.txt"))])


def altered_truth(
    truth: Path, out: Path, keep: slice = slice(None), scatter: bool = False
) -> Path:
    """Some of the rows, their boxes scattered over the picture if wanted."""
    rows = [line.split(",") for line in truth.read_text().splitlines()][keep]
    for k, row in enumerate(rows):
        if scatter:
            row[2] = f"{k * 97 % 250}"
    out.write_text("".join(",".join(row) + "\n" for row in rows))
    return out


def test_the_halves_are_those_of_the_truth_wherever_it_lies(
    annotated: tuple[Path, Path], tmp_path: Path
) -> None:
    scene, truth = annotated
    rows = len(truth.read_text().splitlines())
    late = altered_truth(truth, tmp_path / "late.txt", slice(rows * 2 // 3, None))
    samples = collect([(scene, late)])
    assert np.unique(samples.folds).tolist() == [0, 1]
    assert fit(samples).accuracy is not None


def test_what_cannot_be_held_out_is_not_said_to_be(samples: FeatureSamples) -> None:
    alone = fit(
        replace(samples, folds=samples.folds * 0, step_folds=samples.step_folds * 0)
    )
    assert (alone.accuracy, alone.before) == (None, None)
    assert 0 < alone.chance < 0.3


def test_truth_of_something_else_is_refused_and_nothing_is_written(
    annotated: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, truth = annotated
    out = tmp_path / "features.toml"
    wrong = altered_truth(truth, tmp_path / "wrong.txt", scatter=True)
    assert main(["fit", str(scene), "--truth", str(wrong), "-o", str(out)]) == 1
    assert "no better than any others" in capsys.readouterr().err
    assert (
        main(
            [
                "fit",
                str(scene),
                "--truth",
                str(truth),
                "-o",
                str(out),
                "--plot",
                str(tmp_path / "p.xyz"),
            ]
        )
        == 2
    )
    assert "must end in .png, .pdf or .svg" in capsys.readouterr().err
    twice = tmp_path / "copy.mcap"
    twice.write_bytes(scene.read_bytes())
    words = [
        "fit",
        str(scene),
        str(twice),
        "--truth",
        str(truth),
        "--truth",
        str(truth),
        "-o",
        str(out),
    ]
    assert main(words) == 1
    assert "the same recording as" in capsys.readouterr().err
    assert not out.exists()
