"""Verify names the reason; what a log says of itself is read strictly; states from files are not
trusted.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from fixtures.logs import write_scene_log
from fixtures.planted_differences import copy_log
from fixtures.scenes import generate
from recorders import channels
from recorders.annotated import checkpoint
from recorders.annotated.provenance import provenance_of, sha256, with_fact_digests
from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.log import LogReader, LogWriter
from recorders.messages import Target, Targets
from recorders.scene import SceneLog
from replay import verification
from replay.annotated_writer import replay
from replay.cli import main
from replay.configuration import replay_config
from replay.engine import Engine
from replay.run import ReplayOptions, Spool, SpoolEntry
from replay.verification import verify, verify_chain

FRAMES = 40
Facts = dict[str, str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("verifying")
    write_scene_log(
        generate("pass_by", seed=2, size=(96, 72), frames=FRAMES),
        place / "scene.mcap",
        pictures="none",
    )
    config = replay_config("events", assignments=["events.hindsight=false"])
    replay(
        place / "scene.mcap",
        place / "a.mcap",
        ReplayOptions(config=config, checkpoint_ns=400_000_000),
    )
    return place


def with_facts(
    source: Path, out: Path, change: Callable[[Facts], Facts], reseal: bool = True
) -> Path:
    """The same log saying other things of itself; resealed, as if it had been written so."""

    def facts(values: Facts) -> Facts:
        changed = {k: v for k, v in change(dict(values)).items() if k != "fact_digests"}
        return with_fact_digests(changed) if reseal else changed

    copy_log(source, out, facts=facts)
    return out


def configured(section: str, name: str, value: object) -> Callable[[Facts], Facts]:
    def change(values: Facts) -> Facts:
        configuration = msgspec.json.decode(values["configuration"])
        if value is None:
            del configuration[section][name]
        else:
            configuration.setdefault(section, {})[name] = value
        return {**values, "configuration": msgspec.json.encode(configuration).decode()}

    return change


def test_a_log_of_older_parameters_still_verifies_and_says_what_changed(
    folder: Path, tmp_path: Path
) -> None:
    for change, words in (
        (
            configured("events", "renamed_since", 3),
            "events.renamed_since was 3, there is no such parameter any more",
        ),
        (configured("gone", "x", 1), "gone.x was 1, there is no such parameter any more"),
        (
            configured("interactions", "safety_margin", None),
            "interactions.safety_margin was absent, is 0.25",
        ),
    ):
        verdict = verify(with_facts(folder / "a.mcap", tmp_path / "b.mcap", change))
        assert verdict.identical
        assert [r for r in verdict.reasons if words in r], verdict.reasons
    low = with_facts(
        folder / "a.mcap",
        tmp_path / "b.mcap",
        configured("interactions", "safety_margin", -5.0),
    )
    verdict = verify(low)
    assert any("safety_margin was -5.0, is 0.25" in r for r in verdict.reasons), (
        verdict.reasons
    )


def test_packages_build_and_interpreter_are_named_with_both_versions(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        verification, "package_versions", lambda: {"numpy": "9.9", "new": "1"}
    )
    monkeypatch.setattr(verification, "opencv_build", lambda: "Intel IPP: none")
    monkeypatch.setattr(verification, "python_version", lambda: "CPython 9.0.0")
    reasons = verify(folder / "a.mcap").reasons
    assert any(r.startswith("numpy was 2") and r.endswith("is 9.9") for r in reasons)
    assert "new was absent, is 1" in reasons
    assert any(
        r.startswith("OpenCV's build: Intel IPP was 2") and r.endswith("is none")
        for r in reasons
    )
    assert any(
        r.startswith("Python was CPython 3") and r.endswith("is CPython 9.0.0")
        for r in reasons
    )


def test_a_difference_without_a_known_reason_says_so(folder: Path, tmp_path: Path) -> None:
    """Altered with care: payload, digests and facts all fit one another."""
    from recorders.annotated import digest

    out = tmp_path / "b.mcap"
    with LogReader(folder / "a.mcap") as log, LogWriter(out) as writer:
        ids = {
            c.id: writer.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        link, payloads, last = digest.START, list[tuple[str, bytes]](), ""
        for m in log.messages():
            name, data = channels.split(m.topic)[1], m.data
            if name == "relations" and b'"frame":21,' in data:
                data = data[:-1] + b',"planted":true}'
            if name == "digest":
                d = channels.decode("digest", data)
                made = digest.digest(link, d.frame, m.log_time_ns, d.recorded, payloads)
                data, link, last, payloads = (
                    channels.encode("digest", made),
                    made.link,
                    made.link,
                    [],
                )
            elif name in channels.ANNOTATED:
                payloads.append((name, data))
            writer.write(
                ids[m.channel.id], data, m.log_time_ns, m.publish_time_ns, m.sequence
            )
        (values,) = [v for n, v in log.metadata() if n == "scenetrace"]
        changed = {
            **values,
            "output_digest": last,
            "checkpoints": "{}",
            "checkpoint_ns": "",
            "extras": "{}",
        }
        writer.metadata(
            "scenetrace",
            with_fact_digests({k: v for k, v in changed.items() if k != "fact_digests"}),
        )
    assert verify_chain(out).identical
    verdict = verify(out)
    assert not verdict.identical
    assert (
        str(verdict.difference)
        == "frame 21, relations, planted: recorded True, now nothing"
    )
    assert verdict.reasons[0].startswith("none is known")


def test_a_tracker_that_is_not_ours_is_said(folder: Path, tmp_path: Path) -> None:
    other = with_facts(
        folder / "a.mcap", tmp_path / "b.mcap", lambda v: {**v, "tracker": "mine"}
    )
    with pytest.raises(
        UsageError,
        match=r"the tracker 'mine', which is not installed here .*there are: events",
    ):
        verify(other)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: {k: x for k, x in v.items() if k != "frames"}, "lacks 'frames'"),
        (lambda v: {**v, "frames": "many"}, "frames is 'many', not a number"),
        (lambda v: {**v, "frames": "9" * 5000}, "not a number"),
        (lambda v: {**v, "configuration": "["}, "configuration cannot be read"),
        (lambda v: {**v, "packages": "{}x"}, "packages cannot be read"),
        (lambda v: {**v, "checkpoints": "3"}, "checkpoints cannot be read"),
        (
            lambda v: {**v, "format_version": "7"},
            "a log of format '7'; this scenetrace reads '1'",
        ),
    ],
)
def test_facts_are_read_strictly(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Any,
    words: str,
) -> None:
    for reseal in (True, False):
        altered = with_facts(folder / "a.mcap", tmp_path / "b.mcap", change, reseal)
        with LogReader(altered) as log, pytest.raises(RecordingError, match=words):
            provenance_of(log)
        if "format" in words:
            assert main(["verify", str(altered)]) == 1, "of another version, not altered"
            continue
        for more in ([], ["--quick"]):
            assert main(["verify", str(altered), *more]) == 4
            said = capsys.readouterr().out
            assert re.search(f"reason: altered after the replay: .*{words}", said), said


def test_a_log_without_the_record_of_its_making_was_altered(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "b.mcap"
    with LogReader(folder / "a.mcap") as log, LogWriter(out) as writer:
        ids = {
            c.id: writer.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        for m in log.messages():
            writer.write(
                ids[m.channel.id], m.data, m.log_time_ns, m.publish_time_ns, m.sequence
            )
    for more in ([], ["--quick"]):
        assert main(["verify", str(out), *more]) == 4
        assert (
            "the metadata record 'scenetrace', which every replay writes, is not there"
            in capsys.readouterr().out
        )
    assert main(["verify", str(folder / "scene.mcap")]) == 1, "a scene log was never one"


def test_a_tracker_that_the_configuration_does_not_know_is_named(
    folder: Path, tmp_path: Path
) -> None:
    lie = with_facts(
        folder / "a.mcap", tmp_path / "b.mcap", lambda v: {**v, "tracker": "shells"}
    )
    verdict = verify(lie)
    assert not verdict.identical
    assert verdict.reasons[0].startswith(
        "the tracker is said to be shells, the configuration has none of its parameters"
    )
    assert verdict.reasons[0].endswith("it has those of events: altered")
    assert len(verdict.reasons) < 12, verdict.reasons


@pytest.mark.parametrize(
    ("fact", "value"), [("from_ns", "400000000"), ("to_ns", "1000000000")]
)
def test_frames_outside_of_the_span_that_a_log_names(
    folder: Path, tmp_path: Path, fact: str, value: str
) -> None:
    verdict = verify_chain(
        with_facts(folder / "a.mcap", tmp_path / "b.mcap", lambda v: {**v, fact: value})
    )
    assert not verdict.identical
    assert verdict.difference is not None
    assert (verdict.difference.channel, verdict.difference.field) == ("metadata", fact)
    assert verdict.difference.frame == verdict.frames == (0 if fact == "from_ns" else 25)


def test_two_digests_that_begin_alike_are_shown_where_they_differ(
    folder: Path, tmp_path: Path
) -> None:
    def change(values: Facts) -> Facts:
        link = values["output_digest"]
        return {
            **values,
            "output_digest": link[:40] + ("0" if link[40] != "0" else "1") + link[41:],
        }

    verdict = verify_chain(with_facts(folder / "a.mcap", tmp_path / "b.mcap", change))
    assert verdict.difference is not None
    assert verdict.difference.recorded != verdict.difference.replayed
    assert verdict.difference.recorded.startswith("...")


def test_frames_before_a_difference_are_counted(folder: Path, tmp_path: Path) -> None:
    """Also where nothing differs behind it, and where the replay stops at it."""
    out = tmp_path / "b.mcap"
    with LogReader(folder / "a.mcap") as log, LogWriter(out) as writer:
        ids = {
            c.id: writer.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        detections = 0
        for m in log.messages():
            detections += m.topic.endswith("/detections")
            later = m.topic.endswith("/detections") and detections == 31
            writer.write(
                ids[m.channel.id],
                m.data,
                m.log_time_ns,
                m.publish_time_ns,
                m.sequence + later,
            )
        for a in log.attachments():
            writer.attach(a.name, a.media_type, a.data, a.log_time_ns, a.create_time_ns)
        for name, values in log.metadata():
            writer.metadata(name, values)
    for verdict in (verify(out), verify_chain(out)):
        assert verdict.difference is not None
        assert (verdict.frames, verdict.difference.frame) == (30, 30)


def test_the_scene_beside_is_a_name_never_a_path(folder: Path, tmp_path: Path) -> None:
    span = tmp_path / "span.mcap"
    replay(folder / "scene.mcap", span, ReplayOptions(annotations_only=True))
    away = with_facts(
        span, tmp_path / "b.mcap", lambda v: {**v, "scene": str(folder / "scene.mcap")}
    )
    with pytest.raises(UsageError, match=str(tmp_path / "scene.mcap")):
        verify(away)


def test_the_command_prints_the_reasons(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = with_facts(
        folder / "a.mcap", tmp_path / "b.mcap", configured("shell_model", "k_s", 0.3)
    )
    assert main(["verify", str(wrong)]) == 4
    said = capsys.readouterr().out
    assert "shell_radius" in said
    assert main(["verify", str(folder / "a.mcap")]) == 0
    assert "identical: 40 frames" in capsys.readouterr().out
    assert main(["verify", str(wrong), "--quick", "--json"]) == 0
    capsys.readouterr()
    wrong = with_facts(
        folder / "a.mcap",
        tmp_path / "c.mcap",
        configured("events", "gate", 1.5),
        reseal=False,
    )
    for more in ([], ["--quick"]):
        assert main(["verify", str(wrong), *more]) == 4, (
            "without the facts' digests any fact may be another one"
        )
        assert (
            "the metadata's fact_digests was altered after the replay"
            in capsys.readouterr().out
        )


# -- states that come from files
# -----------------------------------------------------------------------------------


def forged_checkpoints(
    source: Path, out: Path, change: Callable[[dict[str, Any]], None]
) -> Path:
    """A log whose checkpoints were changed with care: their digests fit."""
    digests: dict[str, str] = {}

    def attachment(name: str, data: bytes) -> bytes:
        if not name.startswith(checkpoint.PREFIX):
            return data
        state = checkpoint.decode_state(data)
        change(state)
        made = checkpoint.encode_state(state)
        digests[name] = sha256(made)
        return made

    def facts(values: Facts) -> Facts:
        kept = {k: v for k, v in values.items() if k != "fact_digests"}
        return with_fact_digests(
            {**kept, "checkpoints": msgspec.json.encode(digests, order="sorted").decode()}
        )

    copy_log(source, out, attachment=attachment, facts=facts)
    return out


def _set(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(state: dict[str, Any]) -> None:
        *parts, last = path.split(".")
        for part in parts:
            state = state[part]
        state[last] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        _set("tracker_state", None),
        _set("tracker_state", {}),
        _set("tracker_state.tracks", [1, "two", None]),
        _set("tracker_state.next_id", "one"),
        _set("tracker_state.time_ns", np.zeros((0, 3))),
        _set("reasoner_state", 7),
        _set("reasoner_state", {}),
        _set("frame", 3),
    ],
    ids=["none", "empty", "tracks", "id", "time", "reasoner", "reasoner-empty", "frame"],
)
def test_a_forged_state_ends_in_an_error_of_ours(
    folder: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None]
) -> None:
    forged = forged_checkpoints(folder / "a.mcap", tmp_path / "forged.mcap", change)
    config = replay_config("events", assignments=["events.hindsight=false"])
    options = ReplayOptions(config=config, checkpoints=forged, from_ns=1_300_000_000)
    with pytest.raises(SceneTraceError):
        replay(folder / "scene.mcap", tmp_path / "b.mcap", options)
    assert not (tmp_path / "b.mcap").exists()


def test_an_altered_checkpoint_is_refused(folder: Path, tmp_path: Path) -> None:
    copy_log(
        folder / "a.mcap", tmp_path / "b.mcap",
        attachment=lambda name, data: data.replace(b"\x00", b"\x01", 1) if "checkpoint" in name else data,
    )  # fmt: skip
    config = replay_config("events", assignments=["events.hindsight=false"])
    options = ReplayOptions(
        config=config, checkpoints=tmp_path / "b.mcap", from_ns=1_300_000_000
    )
    with pytest.raises(RecordingError, match="is not what the replay wrote: altered"):
        replay(folder / "scene.mcap", tmp_path / "c.mcap", options)


@pytest.mark.parametrize("shape", [[1 << 63, 0], [0] * 40, [-1], [1 << 41]])
def test_impossible_arrays_are_refused(shape: list[int]) -> None:
    header = msgspec.msgpack.encode(["<f8", shape])
    data = msgspec.msgpack.encode(msgspec.msgpack.Ext(1, bytes([len(header)]) + header))
    with pytest.raises(ValueError, match=r"not a state|array of"):
        checkpoint.decode_state(data)


def test_deep_nesting_is_refused() -> None:
    with pytest.raises(ValueError, match="not a state"):
        checkpoint.decode_state(b"\x91" * 100_000 + b"\x01")


# -- the engine, travelling in time
# ----------------------------------------------------------------------------------


def test_seek_by_seconds_pause_and_thinned_out_states(folder: Path) -> None:
    with SceneLog(folder / "scene.mcap") as scene:
        straight = [found.annotation for found in Engine(scene).run()]
        engine = Engine(scene, keep_every=1)
        assert engine.seek(0.5).frame.index == 12
        assert engine.seek(0.0).annotation == straight[0]
        assert engine.seek(100.0).frame.index == FRAMES - 1
        assert engine.seek(7).annotation == straight[7]
        for found in engine.run():
            if found.frame.index == 15:
                engine.pause()
        assert engine.current.frame.index == 15
        assert next(engine.run()).annotation == straight[16]
        with pytest.raises(IndexError, match="starts at 0 s"):
            engine.seek(-1.0)
        with pytest.raises(IndexError, match="count from 0"):
            engine.seek(-1)


def test_a_state_goes_to_another_engine_and_to_no_other_tracker(folder: Path) -> None:
    with SceneLog(folder / "scene.mcap") as scene:
        engine = Engine(scene)
        with pytest.raises(IndexError, match=r"step\(\) first"):
            engine.state()
        engine.seek(20)
        state = engine.state()
        expected = engine.step().annotation
        other = Engine(scene)
        other.restore(state)
        assert other.state()["frame"] == 20
        assert other.step().annotation == expected
        with pytest.raises(UsageError, match="configuration"):
            Engine(
                scene, config=replay_config("events", assignments=["events.gate=3.5"])
            ).restore(state)
        with pytest.raises(SceneTraceError, match="not a state of an engine"):
            other.restore({"frame": 3})


@pytest.mark.parametrize("number", [int, float, np.int64, np.float32, np.float64])
def test_seek_takes_numbers_of_any_make(
    folder: Path, number: Callable[[float], float]
) -> None:
    with SceneLog(folder / "scene.mcap") as scene:
        found = Engine(scene).seek(number(1))
        assert found.frame.index == (1 if number in (int, np.int64) else 25)


def test_seek_to_no_number_says_so(folder: Path) -> None:
    with SceneLog(folder / "scene.mcap") as scene:
        engine = Engine(scene)
        nowhere: list[Any] = [float("nan"), float("inf"), np.float32("-inf")]
        for wrong in nowhere:
            with pytest.raises(IndexError, match="no time of the scene"):
                engine.seek(wrong)
        with pytest.raises(TypeError, match="'2': must be a frame's number"):
            engine.seek("2")  # type: ignore[arg-type]


def test_a_state_of_another_recording_is_refused(folder: Path, tmp_path: Path) -> None:
    other = generate("pass_by", seed=3, size=(96, 72), frames=FRAMES)
    write_scene_log(other, tmp_path / "other.mcap", pictures="none")
    with (
        SceneLog(folder / "scene.mcap") as scene,
        SceneLog(tmp_path / "other.mcap") as another,
    ):
        engine = Engine(scene)
        engine.seek(20)
        with pytest.raises(UsageError, match=r"of another recording than .*other\.mcap"):
            Engine(another).restore(engine.state())


def test_a_restore_that_fails_leaves_the_engine_where_it_was(
    folder: Path, tmp_path: Path
) -> None:
    with SceneLog(folder / "scene.mcap") as scene:
        straight = [found.annotation for found in Engine(scene).run()]
        engine = Engine(scene)
        engine.seek(10)
        state = engine.state()
        engine.seek(20)
        for wrong in (
            {**state, "tracker_state": {}},
            {**state, "reasoner_state": {}},
            {**state, "recorded": "no"},
        ):
            with pytest.raises(SceneTraceError):
                engine.restore(wrong)
            assert engine.current is not None
            assert engine.current.frame.index == 20
        assert engine.step().annotation == straight[21]
        engine.restore(state)
        assert engine.step().annotation == straight[11]


def test_the_spool_gives_back_what_it_took_in_several_readings_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("replay.run._BLOCK", 64)
    made = [
        SpoolEntry(
            Targets(k, [Target(i, (1.0, 2.0, 3.0, 4.0)) for i in range(k % 5)]),
            (("x", b"y" * (k * 37)),),
        )
        for k in range(30)
    ]
    with Spool() as spool:
        for entry in made:
            spool.append(entry)
        first, second = spool.entries(), spool.entries(10)
        mixed = [(next(first), next(second)) for _ in range(20)]
        assert [a for a, _ in mixed] == made[:20]
        assert [b for _, b in mixed] == made[10:]
        assert list(spool.targets()) == [entry.targets for entry in made]


def test_facts_know_their_log(folder: Path) -> None:
    with LogReader(folder / "a.mcap") as log:
        facts = provenance_of(log)
    assert facts.altered() == {}
    assert facts.configuration["events"]["hindsight"] is False
    assert facts.python.startswith("CPython 3.")
    assert facts.machine
    assert facts.opencv_build["Baseline"]
    assert facts.whole
    assert sorted(facts.checkpoints or {}) == [checkpoint.name(k) for k in (10, 20, 30)]


def test_the_documented_travel_in_time(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (Path(__file__).resolve().parents[2] / "docs" / "trust.md").read_text(
        encoding="utf-8"
    )
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(folder)
    found: dict[str, Any] = {}
    exec(code, found)
    assert found["engine"].state()["frame"] == found["state"]["frame"] == FRAMES - 1
