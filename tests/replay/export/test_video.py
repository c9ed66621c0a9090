"""The overlaid video, decoded again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from recorders.annotated.reader import AnnotatedLog
from recorders.errors import RecordingError, UsageError
from replay.cli import main
from replay.draw import DrawOptions
from replay.export import VideoOptions, write_video
from replay.export.video import overlaid


def decoded(path: Path) -> list[tuple[float, Any]]:
    with av.open(str(path)) as container:
        return [
            (float(f.time), f.to_ndarray(format="bgr24")) for f in container.decode(video=0)
        ]


def test_every_frame_at_its_time(write_annotated: Any, tmp_path: Path) -> None:
    out = tmp_path / "v.mp4"
    assert (
        main(
            [
                "export",
                str(write_annotated()),
                "--to",
                "video",
                "-o",
                str(out),
                "--scale",
                "1.5",
            ]
        )
        == 0
    )
    frames = decoded(out)
    assert len(frames) == 30
    assert [t for t, _ in frames] == pytest.approx([k / 10 for k in range(30)])
    assert frames[0][1].shape == (180, 240, 3)


def test_a_span_of_it(write_annotated: Any, tmp_path: Path) -> None:
    out = tmp_path / "v.mp4"
    words = ["--from", "frame:10", "--until", "1.5", "--no-shells", "--only", "1"]
    assert (
        main(["export", str(write_annotated()), "--to", "video", "-o", str(out), *words])
        == 0
    )
    assert len(decoded(out)) == 5
    log = write_annotated("b.mcap")
    with (
        AnnotatedLog(log) as opened,
        pytest.raises(RecordingError, match="no frame in the span"),
    ):
        write_video(opened, tmp_path / "w.mp4", VideoOptions(from_ns=10**15))
    assert not (tmp_path / "w.mp4").exists()


def test_pictures_are_the_frames_own(write_annotated: Any) -> None:
    bare = DrawOptions(
        1.0,
        boxes=False,
        labels=False,
        shells=False,
        edges=False,
        groups=False,
        regions=False,
    )
    with AnnotatedLog(write_annotated()) as log:
        drawn = [
            image
            for _, image in overlaid(
                log, VideoOptions(bare, events_s=0.0, quiet=("joined",))
            )
        ]
    # The middle of frame k is grey 60 + 4 k; the top holds the title.
    assert [int(image[60, 80, 0]) for image in drawn] == pytest.approx(
        [60 + 4 * k for k in range(30)], abs=2
    )


def test_event_texts_stay_for_a_while(write_annotated: Any) -> None:
    bare = DrawOptions(
        1.0,
        boxes=False,
        labels=False,
        shells=False,
        edges=False,
        groups=False,
        regions=False,
    )
    with AnnotatedLog(write_annotated()) as log:
        drawn = [image for _, image in overlaid(log, VideoOptions(bare, events_s=0.5))]
    dark = [
        k
        for k, image in enumerate(drawn)
        if image[118, 150].max() < 0.6 * image[60, 80].min()
    ]
    assert dark == list(range(8, 18))


def test_who_owns_which_pixels_is_shown(write_annotated: Any) -> None:
    with (
        AnnotatedLog(write_annotated(membership=True)) as log,
        AnnotatedLog(write_annotated("plain.mcap")) as plain,
    ):
        options = VideoOptions(DrawOptions(1.0, regions=False))
        tinted = [image for _, image in overlaid(log, options)]
        others = [image for _, image in overlaid(plain, options)]
    assert np.any(tinted[0][50:70, 14:26] != others[0][50:70, 14:26])
    assert np.array_equal(tinted[0][110:], others[0][110:])


def test_without_pictures_the_ground_is_plain(
    write_annotated: Any, tmp_path: Path, capsys: Any
) -> None:
    out = tmp_path / "v.mp4"
    assert (
        main(
            [
                "export",
                str(write_annotated(pictures=False)),
                "--to",
                "video",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    assert "no pictures" in capsys.readouterr().err
    assert len(decoded(out)) == 30
    with AnnotatedLog(write_annotated("bare.mcap", recorded=False)) as log:
        with pytest.raises(UsageError, match="neither pictures nor their size"):
            write_video(log, tmp_path / "w.mp4")
        assert write_video(log, tmp_path / "w.mp4", VideoOptions(size=(161, 121))) == 30
    assert decoded(tmp_path / "w.mp4")[0][1].shape[1] % 2 == 0


def test_times_are_those_of_the_whole_recording(
    write_annotated: Any, tmp_path: Path, capsys: Any
) -> None:
    """Frame 20 of a log that holds frames 15 to 24 only is still 2.0 s into the recording."""
    log = write_annotated(frames=range(15, 25), recorded=False)
    for start in ("2.0", "frame:20", "1970-01-01T00:00:07Z"):
        out = tmp_path / f"{start.replace(':', '-')}.mp4"
        words = ["--from", start, "--size", "160x120", "--scale", "1"]
        assert main(["export", str(log), "--to", "video", "-o", str(out), *words]) == 0
        assert len(decoded(out)) == 5
    assert (
        main(
            [
                "export",
                str(log),
                "--to",
                "video",
                "-o",
                str(tmp_path / "x.mp4"),
                "--from",
                "frame:3",
            ]
        )
        == 2
    )
    assert "frame:3: not in" in capsys.readouterr().err
