"""Forgeries: annotated logs that somebody altered with more than one careless byte; each is told
in a line.

Each rewrites a log whole, with checksums that fit, and lies in another way: frames dropped,
appended or repeated, numbers and times moved, checkpoints swapped, attachments replaced, records
added, digests made anew. Whoever holds a log against its own digests, or against a new replay,
must find every one of them and say so in a line.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from msgspec.structs import replace as altered

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders import channels
from recorders.annotated import digest
from recorders.annotated.provenance import METADATA, with_fact_digests
from recorders.log import Attachment, LogReader, LogWriter, Message
from replay.annotated_writer import replay
from replay.cli import main
from replay.run import ReplayOptions

Messages = list[Message]
Records = list[tuple[str, dict[str, str]]]


@dataclass
class Content:
    """All that a log holds, to be changed at will."""

    messages: Messages
    attachments: list[Attachment]
    records: Records

    def facts(self, **changes: str) -> None:
        """Other facts, with digests that fit."""
        for k, (name, values) in enumerate(self.records):
            if name == METADATA:
                kept = {
                    n: v for n, v in {**values, **changes}.items() if n != "fact_digests"
                }
                self.records[k] = name, with_fact_digests(kept)


Forgery = Callable[[Content], None]


def forge(source: Path, out: Path, forgery: Forgery) -> Path:
    """Write ``source`` anew, forged."""
    with LogReader(source) as log:
        content = Content(list(log.messages()), list(log.attachments()), log.metadata())
    forgery(content)
    pictures = [
        m.topic
        for m in content.messages
        if m.topic.endswith(("/image", "/foreground", "/membership"))
    ]
    with LogWriter(out, force=True, picture_topics=sorted({*pictures})) as writer:
        for m in sorted(content.messages, key=lambda m: m.log_time_ns):
            number = writer.channel(
                m.topic, m.channel.schema, m.channel.message_encoding, m.channel.metadata
            )
            writer.write(number, m.data, m.log_time_ns, m.publish_time_ns, m.sequence)
        for a in content.attachments:
            writer.attach(a.name, a.media_type, a.data, a.log_time_ns, a.create_time_ns)
        for name, values in content.records:
            writer.metadata(name, values)
    return out


def named(message: Message) -> str:
    """The channel's name."""
    return channels.split(message.topic)[1]


def annotated(message: Message) -> bool:
    """Whether a replay wrote it."""
    return named(message) in channels.ANNOTATED


def _times(content: Content) -> list[int]:
    return [m.log_time_ns for m in content.messages if named(m) == "digest"]


def _first(content: Content, name: str, frame: int) -> int:
    """The place of a channel's first message of a frame or after it."""
    limit = 0 if name == "events" else _times(content)[frame]
    return next(
        k
        for k, m in enumerate(content.messages)
        if named(m) == name and m.log_time_ns >= limit
    )


def _last_frames_dropped(content: Content) -> None:
    end = _times(content)[-4]
    content.messages = [m for m in content.messages if m.log_time_ns < end]


def _last_annotations_dropped_with_care(content: Content) -> None:
    """Count and last link fit what is left."""
    end = _times(content)[-4]
    content.messages = [
        m for m in content.messages if m.log_time_ns < end or not annotated(m)
    ]
    digests = [m for m in content.messages if named(m) == "digest"]
    link = channels.decode("digest", digests[-1].data).link
    content.facts(frames=str(len(digests)), output_digest=link)


def _first_frame_dropped(content: Content) -> None:
    start = _times(content)[0]
    content.messages = [m for m in content.messages if m.log_time_ns != start]


def _frame_appended(content: Content) -> None:
    last = _times(content)[-1]
    later = [altered(m, log_time_ns=m.log_time_ns + 40_000_000, publish_time_ns=m.publish_time_ns + 40_000_000)
             for m in content.messages if m.log_time_ns == last]  # fmt: skip
    content.messages += later


def _message_repeated(name: str) -> Forgery:
    def forgery(content: Content) -> None:
        at = _first(content, name, 12)
        content.messages.insert(at, content.messages[at])

    return forgery


def _field(name: str, **change: int) -> Forgery:
    def forgery(content: Content) -> None:
        at = _first(content, name, 12)
        m = content.messages[at]
        values = {field: getattr(m, field) + by for field, by in change.items()}
        content.messages[at] = altered(m, **values)

    return forgery


def _garbage(name: str) -> Forgery:
    def forgery(content: Content) -> None:
        at = _first(content, name, 12)
        content.messages[at] = altered(content.messages[at], data=b"\xff{nonsense")

    return forgery


def _box_moved(content: Content, name: str) -> None:
    limit = _times(content)[12]
    at = next(k for k, m in enumerate(content.messages)
              if named(m) == name and m.log_time_ns >= limit and b'"box":[' in m.data)  # fmt: skip
    m = content.messages[at]
    content.messages[at] = altered(m, data=m.data.replace(b'"box":[', b'"box":[1', 1))


def _tracks_with_stale_digests(content: Content) -> None:
    _box_moved(content, "tracks")


def _targets_with_stale_digests(content: Content) -> None:
    """What hindsight starts from, where a replay starts at a checkpoint."""
    _box_moved(content, "targets")


def _digests_made_anew(content: Content) -> None:
    """Altered with care: every digest fits, only a new replay can tell."""
    _tracks_with_stale_digests(content)
    link, payloads = digest.START, list[tuple[str, bytes]]()
    for k, m in enumerate(content.messages):
        if named(m) == "digest":
            said = channels.decode("digest", m.data)
            made = digest.digest(link, said.frame, m.log_time_ns, said.recorded, payloads)
            content.messages[k] = altered(m, data=channels.encode("digest", made))
            link, payloads = made.link, []
        elif annotated(m):
            payloads.append((named(m), m.data))
    content.facts(output_digest=link)


def _metadata_swapped(content: Content) -> None:
    """The facts of a replay with another parameter and of another output, digests included."""
    content.facts(output_digest="0" * 64)


def _second_metadata(content: Content) -> None:
    for name, values in list(content.records):
        if name == METADATA:
            content.records.append((name, {**values, "tracker": "shells"}))


def _recording_metadata(content: Content) -> None:
    content.records = [
        (n, v if n == METADATA else {**v, "source": "elsewhere.avi"})
        for n, v in content.records
    ]


def _checkpoints_swapped(content: Content) -> None:
    a, b = content.attachments[-2:]
    content.attachments[-2:] = [replace(a, data=b.data), replace(b, data=a.data)]


def _checkpoint_removed(content: Content) -> None:
    content.attachments.pop()


def _checkpoint_moved(content: Content) -> None:
    content.attachments[-1] = replace(content.attachments[-1], log_time_ns=1)


def _checkpoint_field(**change: object) -> Forgery:
    def forgery(content: Content) -> None:
        content.attachments[-1] = replace(content.attachments[-1], **change)  # type: ignore[arg-type]

    return forgery


def _attachment_added(content: Content) -> None:
    content.attachments.append(
        Attachment("notes.txt", "text/plain", 0, 0, b"it was the butler")
    )


def _channel_added(content: Content) -> None:
    m = content.messages[_first(content, "tracks", 12)]
    content.messages.append(altered(m, channel=replace(m.channel, topic="/another/tracks")))


def _schema_altered(content: Content) -> None:
    for k, m in enumerate(content.messages):
        if named(m) == "tracks" and m.channel.schema is not None:
            schema = replace(m.channel.schema, name="scenetrace.Other")
            content.messages[k] = altered(m, channel=replace(m.channel, schema=schema))


def _recorded_behind_the_end(content: Content) -> None:
    last = next(
        m
        for m in reversed(content.messages)
        if named(m) == "regions" or named(m) == "detections"
    )
    later = last.log_time_ns + 1
    regions = [m for m in content.messages if named(m) == "regions"]
    source = regions[0] if regions else last
    content.messages.append(altered(source, log_time_ns=later, publish_time_ns=later))


def _detections_gone(content: Content) -> None:
    content.messages = [m for m in content.messages if named(m) != "detections"]


def _everything_gone(content: Content) -> None:
    content.messages = []


FORGERIES: dict[str, Forgery] = {
    "the last frames dropped": _last_frames_dropped,
    "the last annotations dropped, count and link made to fit": (
        _last_annotations_dropped_with_care
    ),
    "the first frame dropped": _first_frame_dropped,
    "a frame appended": _frame_appended,
    "tracks twice": _message_repeated("tracks"),
    "a digest twice": _message_repeated("digest"),
    "detections twice": _message_repeated("detections"),
    "a picture twice": _message_repeated("image"),
    "a sequence number of tracks": _field("tracks", sequence=1),
    "a publish time of an event": _field("events", publish_time_ns=1),
    "a sequence number of a digest": _field("digest", sequence=-1),
    "a sequence number of detections": _field("detections", sequence=7),
    "a publish time of detections": _field("detections", publish_time_ns=1),
    "a log time of tracks": _field("tracks", log_time_ns=1),
    "nonsense for tracks": _garbage("tracks"),
    "nonsense for a digest": _garbage("digest"),
    "nonsense for detections": _garbage("detections"),
    "nonsense for a picture": _garbage("image"),
    "nonsense for a mask": _garbage("foreground"),
    "tracks, digests left as they were": _tracks_with_stale_digests,
    "targets, digests left as they were": _targets_with_stale_digests,
    "tracks, digests made anew": _digests_made_anew,
    "another output digest in the metadata": _metadata_swapped,
    "a second metadata record": _second_metadata,
    "metadata of the recording": _recording_metadata,
    "two checkpoints swapped": _checkpoints_swapped,
    "a checkpoint removed": _checkpoint_removed,
    "a checkpoint moved in time": _checkpoint_moved,
    "a checkpoint of another media type": _checkpoint_field(media_type="text/plain"),
    "a checkpoint created at another time": _checkpoint_field(create_time_ns=5),
    "an attachment added": _attachment_added,
    "a channel added": _channel_added,
    "another schema of tracks": _schema_altered,
    "recorded messages behind the end": _recorded_behind_the_end,
    "detections gone": _detections_gone,
    "everything gone": _everything_gone,
}
# Says nothing that can be replayed or compared by.
UNREADABLE = {"a second metadata record"}
# Only a new replay can tell.
CAREFUL = {"tracks, digests made anew"}
# What happens is the same: told by `verify` alone.
SAME_STORY = {
    "another output digest in the metadata",
    "metadata of the recording",
    "two checkpoints swapped",
    "a checkpoint removed",
    "a checkpoint moved in time",
    "a checkpoint of another media type",
    "a checkpoint created at another time",
    "an attachment added",
    "another schema of tracks",
}


SPAN = ("--from", "frame:25", "--annotations-only", "--checkpoints")


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("forgeries")
    scene = generate("three_way_group", seed=1, size=(160, 120), frames=40)
    write_scene_log(scene, folder / "scene.mcap", style="merged", pictures="png")
    replay(
        folder / "scene.mcap",
        folder / "annotated.mcap",
        ReplayOptions(checkpoint_ns=400_000_000),
    )
    return folder / "annotated.mcap"


@pytest.fixture(scope="module")
def unforged(
    original: Path, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[str, int, int, bytes]]:
    """What a replay from a checkpoint of the original writes."""
    scene, out = original.with_name("scene.mcap"), tmp_path_factory.mktemp("a") / "a.mcap"
    assert main(["replay", str(scene), *SPAN, str(original), "-o", str(out)]) == 0
    return messages(out)


def said(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str]:
    """A command's exit code and what it printed; whatever goes wrong is one line, never a
    traceback.
    """
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    if code == 1:
        assert err.count("\n") == 1, err
        assert err.startswith("scenetrace: error: ")
    return code, out + err


@pytest.mark.parametrize("forgery", FORGERIES)
def test_every_forgery_is_told(
    original: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], forgery: str
) -> None:
    forged = forge(original, tmp_path / "forged.mcap", FORGERIES[forgery])
    code, words = said(capsys, "doctor", forged)
    assert code == 0, "the file itself is sound"

    if forgery in UNREADABLE:
        for command in (
            ("verify", forged),
            ("verify", forged, "--quick"),
            ("diff", original, forged),
        ):
            code, words = said(capsys, *command)
            assert (code, "altered" in words) == (
                4 if command[0] == "verify" else 1,
                True,
            ), words
        return
    code, words = said(capsys, "verify", forged, "--quick")
    assert code == (0 if forgery in CAREFUL else 4), words
    assert code == 0 or re.search(
        r"  reason: .*(altered|removed|added|moved|were written|were recorded|does not"
        r" end)",
        words,
    ), words
    code, words = said(capsys, "verify", forged)
    assert code == 4, words
    assert "  reason: " in words
    code, words = said(capsys, "diff", original, forged)
    if forgery in SAME_STORY:
        assert code == 0, words
    elif "nonsense for" in forgery or "gone" in forgery or "twice" in forgery:
        assert code in (1, 4), words
    else:
        assert code == 4, words


@pytest.mark.parametrize("forgery", FORGERIES)
def test_no_forgery_goes_into_a_replay_from_a_checkpoint(
    original: Path,
    unforged: list[tuple[str, int, int, bytes]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    forgery: str,
) -> None:
    """Refused, or without a trace in what is written."""
    forged = forge(original, tmp_path / "forged.mcap", FORGERIES[forgery])
    scene = original.with_name("scene.mcap")
    code, words = said(capsys, "replay", scene, *SPAN, forged, "-o", tmp_path / "b.mcap")
    if code:
        assert code in (1, 2), words
        assert not (tmp_path / "b.mcap").exists()
        return
    assert messages(tmp_path / "b.mcap") == unforged


def messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    with LogReader(path) as log:
        return [(m.topic, m.log_time_ns, m.sequence, m.data) for m in log.messages()]


def test_a_copy_is_no_forgery(
    original: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = forge(original, tmp_path / "copy.mcap", lambda _: None)
    for command in (
        ("verify", copy, "--quick"),
        ("verify", copy),
        ("diff", original, copy),
    ):
        code, words = said(capsys, *command)
        assert code == 0, words
        assert words.startswith("identical: 40 frames")
        assert "without effect" not in words


def test_a_picture_with_a_wrong_bit_is_told_in_our_own_words(
    original: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def flipped(content: Content) -> None:
        at = _first(content, "image", 12)
        m = content.messages[at]
        content.messages[at] = altered(
            m, data=m.data[:-200] + bytes([m.data[-200] ^ 1]) + m.data[-199:]
        )

    forged = forge(original, tmp_path / "forged.mcap", flipped)
    capfd.readouterr()
    assert main(["verify", str(forged)]) == 4
    out, err = capfd.readouterr()
    (line,) = err.splitlines()
    assert re.fullmatch(
        r"scenetrace: left out: a damaged png picture: the CRC of its IDAT chunk at byte \d+"
        r" differs, at 480000000 ns on /camera/image \(frame 12\)",
        line,
    )
    assert out.startswith("differs after 12 equal frames: frame 12, recorded messages")


def test_bytes_behind_the_end_are_told_as_such(
    original: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    longer = tmp_path / "longer.mcap"
    whole = original.read_bytes()
    for behind in (b"x", b"\x00" * 5000, whole[-8:] * 3):
        longer.write_bytes(whole + behind)
        code, words = said(capsys, "verify", longer)
        assert code == 1
        assert f"at byte {len(whole)}: {len(behind)} bytes follow the file's end" in words
        assert main(["doctor", str(longer)]) == 1
        assert "bytes follow the file's end" in capsys.readouterr().out


def test_a_cut_file_is_damaged_at_a_byte(
    original: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = original.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    flipped = tmp_path / "flipped.mcap"
    at = len(whole) // 3
    flipped.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
    for file in (cut, flipped):
        for command in (
            ("verify", file),
            ("verify", file, "--quick"),
            ("diff", original, file),
            ("doctor", file),
        ):
            code, words = (
                said(capsys, *command)
                if command[0] != "doctor"
                else (main(["doctor", str(file)]), "")
            )
            assert code == 1, words
            assert re.search(r"byte +\d+", words or capsys.readouterr().out)
