"""What `scenetrace.open` gives is what the log has."""

from __future__ import annotations

import json
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

import scenetrace
from recorders.annotated.reader import AnnotatedLog
from recorders.log import LogReader


def messages(path: Path, name: str) -> list[tuple[int, dict[str, object]]]:
    """A channel as another program reads it: log time and JSON."""
    with LogReader(path) as log:
        return [
            (m.log_time_ns, json.loads(m.data)) for m in log.messages([f"/camera/{name}"])
        ]


def test_every_frame_is_as_the_log_has_it(folder: Path) -> None:
    path = folder / "annotated.mcap"
    with AnnotatedLog(path) as plain, scenetrace.open(path) as log:
        expected = list(plain.frames())
        assert len(log) == len(expected) == 120
        for found, there in zip(log, expected, strict=True):
            for frame in (found, log[there.index]):
                assert (frame.index, frame.time_ns) == (there.index, there.time_ns)
                assert frame.tracks == there.tracks
                assert frame.relations == there.relations
                assert frame.groups == there.groups
                assert frame.events == there.events
                assert frame.regions == there.regions
                assert frame.present == [t for t in there.tracks if t.present]


def test_frames_are_reached_by_number_slice_and_time(folder: Path) -> None:
    with scenetrace.open(folder / "annotated.mcap") as log:
        assert log[-1].index == 119
        assert [f.index for f in log[10:16:2]] == [10, 12, 14]
        assert [f.index for f in log[-2:]] == [118, 119]
        assert log.at(2.0).index == 50
        assert log.at(2.039).index == 50
        assert log[50].t == pytest.approx(2.0)
        assert next(reversed(log)).index == 119
        for wrong in (120, -121):
            with pytest.raises(IndexError, match=r"annotated\.mcap has"):
                log[wrong]
        for wrong_time in (-0.1, 100.0):
            with pytest.raises(IndexError, match="frames 0 to 119"):
                log.at(wrong_time)


def test_a_span_keeps_the_recordings_numbers(folder: Path) -> None:
    with (
        scenetrace.open(folder / "annotated.mcap") as whole,
        scenetrace.open(folder / "span.mcap") as span,
    ):
        assert len(span) == 10
        assert span[35].tracks == whole[35].tracks
        assert span[35].t == pytest.approx(whole[35].t)
        assert [f.index for f in span[:33]] == [30, 31, 32]
        assert span[-1].index == 39
        assert span[35].picture is None
        assert span[35].detections is None
        assert not span.has_recording
        with pytest.raises(IndexError, match="frames 30 to 39"):
            span[0]


def test_pictures_come_in_any_order_and_are_the_recorded_ones(folder: Path) -> None:
    with (
        scenetrace.SceneLog(folder / "scene.mcap") as scene,
        scenetrace.open(folder / "annotated.mcap") as log,
    ):
        pictures = [frame.image for frame in scene.frames()]
        for k in (80, 3, 4, 119, 0):
            found = log[k].picture
            assert found is not None
            assert found.dtype == np.uint8
            assert found.shape == (180, 240, 3)
            np.testing.assert_array_equal(found, pictures[k])
        for frame in log[5:8]:
            np.testing.assert_array_equal(frame.picture, pictures[frame.index])
        assert log[7].mask is not None
        assert log[7].detections is not None
        assert log.size == (240, 180)


def test_a_scene_log_opens_too_and_says_that_nothing_was_tracked(folder: Path) -> None:
    with scenetrace.open(folder / "scene.mcap") as log:
        assert not log.annotated
        assert len(log) == 120
        assert log[3].picture is not None
        with pytest.raises(scenetrace.RecordingError, match="scenetrace replay"):
            _ = log[3].tracks
        with pytest.raises(scenetrace.RecordingError, match="no graph"):
            _ = log.graph


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_bytes(b"nothing")
    for name in ("no.mcap", "none.mcap"):
        with pytest.raises(scenetrace.SceneTraceError, match=name):
            scenetrace.open(tmp_path / name)


def test_the_graph_of_a_frame_is_the_logs_latest(folder: Path, tmp_path: Path) -> None:
    path = folder / "annotated.mcap"
    written = messages(path, "graph")
    with scenetrace.open(path) as log:
        for k in (0, 40, 80, 119):
            frame = log[k]
            latest = [g for time_ns, g in written if time_ns <= frame.time_ns][-1]
            graph = frame.graph
            assert graph is not None
            assert scenetrace.to_networkx(frame) is graph
            assert list(graph.nodes) == [n["id"] for n in latest["nodes"]]  # type: ignore[attr-defined]
            assert {(frozenset((a, b)), key) for a, b, key in graph.edges(keys=True)} == {
                (frozenset((e["source"], e["target"])), e["key"])
                for e in latest["edges"]  # type: ignore[attr-defined]
            }
            open_pairs = {
                frozenset((a, b))
                for a, b, d in graph.edges(data=True)
                if d["view"] == "SHELLS" and "end_frame" not in d
            }
            assert open_pairs == {
                frozenset((f"target:{r.a}", f"target:{r.b}")) for r in frame.relations
            }
            nx.write_graphml(graph, tmp_path / "g.graphml")
        over_time = scenetrace.to_networkx(log)
        nx.write_graphml(over_time, tmp_path / "g.graphml")
        assert over_time.number_of_edges() > 0
        assert over_time.graph["tracker"] == "events"


def test_questions_are_answered_as_rows_arrow_and_pandas(folder: Path) -> None:
    with scenetrace.open(folder / "annotated.mcap") as log:
        rows = log.sql(
            "SELECT frame, t, track, x FROM tracks WHERE track = ? ORDER BY frame", [1]
        )
        assert rows.columns == ["frame", "t", "track", "x"]
        assert rows[0][2] == 1
        assert rows.dicts()[0]["frame"] == rows[0][0]
        arrow, frame = rows.to_arrow(), rows.to_pandas()
        assert arrow.num_rows == len(frame) == len(rows)
        assert arrow.column("x").to_pylist() == [row[3] for row in rows]
        assert list(frame["frame"]) == [row[0] for row in rows]
        met = log.ask("met", 1)
        assert "explain" in met.columns
        assert list(met) == list(scenetrace.ask(folder / "annotated.mcap", "met", 1))
        sure, all_of_them = log.ask("met", 1, certainty=1.0), log.ask("met", 1, certainty=0)
        assert sure.left_out == len(all_of_them) - len(sure)
        assert all_of_them.left_out == 0 < sure.left_out
        assert len(log.ask("who-was-in", "scene", at=2.0)) == len(
            log.ask("who-was-in", "scene", at="frame:50")
        )
        with pytest.raises(scenetrace.UsageError, match="target '99': there is none"):
            log.ask("met", 99)
        count = "SELECT count(*) FROM tracks"
        assert list(scenetrace.query([folder / "annotated.mcap"], count)) == list(
            log.sql(count)
        )


def test_present_tracks_are_those_of_the_mot_export(folder: Path) -> None:
    from replay.export import write_mot

    path = folder / "annotated.mcap"
    with AnnotatedLog(path) as plain:
        rows = write_mot(plain, folder / "mot.txt", force=True)
    with scenetrace.open(path) as log:
        assert sum(len(frame.present) for frame in log) == rows
        assert list(log.sql("SELECT count(*) FROM tracks WHERE present")) == [(rows,)]
