"""Verify: replay again from what an annotated log says of itself, and name the first difference
and its reason.

First the log is held against its own digests (`recorders.annotated.chain`), then the recording against the
digests that the log has of it, then a new replay against the log, frame by frame. So a difference
is told apart by its cause: the log was altered, the recording was, the configuration or a package
is another one, or the replay itself went another way.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from recorders import channels
from recorders.annotated import checkpoint, digest
from recorders.annotated.chain import (
    RECORDED,
    WHOLE,
    FrameRecord,
    ReplayDifference,
    Verification,
    recorded_frames,
    short_digests,
    verify_chain,
)
from recorders.annotated.checkpoint import Checkpoint
from recorders.annotated.provenance import (
    AlteredFactsError,
    Provenance,
    build_facts,
    provenance_of,
)
from recorders.errors import LimitError, RecordingError, SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.machine import machine, opencv_build, python_version
from recorders.messages import Digest
from recorders.scene import SceneLog
from recorders.vision import opencv_threads
from replay.configuration import package_versions, recorded_config
from replay.first_difference import difference_in, first_unequal, shorten
from replay.protocol import is_tracker
from replay.run import Annotated, Progress, ReplayOptions, Run
from replay.trackers.catalogue import TRACKER_SECTIONS, TRACKERS
from replay.trackers.choice import AnyTracker, TrackerChoice, choose

__all__ = [
    "FrameRecord",
    "ReplayDifference",
    "Verification",
    "provenance_of",
    "recorded_frames",
    "verify",
    "verify_chain",
]


def verify(
    path: str | Path,
    scene: str | Path | None = None,
    *,
    tracker: AnyTracker | None = None,
    limits: Limits = DEFAULT_LIMITS,
    progress: Progress | None = None,
) -> Verification:
    """Replay again with the recorded tracker and configuration and compare, frame by frame.

    Args:
        path: the annotated log.
        scene: the scene log, where the annotated log does not hold the recording whole; a file of
            the recorded name beside the annotated log is found by itself.
        tracker: the tracker, where nothing that is installed bears the name that the log says; a
            module in the working folder is imported only if it is named here.
        limits: bounds for reading.
        progress: called with the stage's name and the frame's number.

    Raises:
        RecordingError: a log cannot be read.
        UsageError: the recording is not at hand, or the log's tracker is unknown here.
    """
    chain = verify_chain(path, limits, progress)
    with LogReader(path, limits) as log:
        try:
            facts = provenance_of(log)
        except AlteredFactsError:
            return chain  # which says so; nothing else is known to replay it by
        choice = choice_of(facts) if tracker is None else choose(tracker)
        config, changes = recorded_config(choice, facts.configuration)
        changes = [*_another_tracker(facts, choice), *changes]
        options = ReplayOptions(
            tracker=choice,
            config=config,
            camera=facts.camera,
            checkpoint_ns=facts.checkpoint_ns,
            limits=limits,
            regions=facts.regions,
            corrections=facts.corrections,
        )
        try:
            with (
                opencv_threads(1),
                SceneLog(
                    _scene_of(Path(path), facts, scene), facts.camera, limits, facts.regions
                ) as source,
            ):
                changed = _changed_input(source, log, facts)
                comparing = _Comparing(
                    Run(source, options, progress), log, facts, links=changed is None
                )
                effect, stopped = _compared(
                    comparing, certain=changed is None and chain.identical
                )
                frames = comparing.frames
        except SceneTraceError as error:
            # An altered recording need not be one that can be replayed; what was altered is known
            # already.
            if chain.identical or scene is not None:
                raise
            return replace(
                chain,
                reasons=[
                    *chain.reasons,
                    f"it cannot be replayed any more: {_reason(error)}",
                ],
            )
    reasons = [*chain.reasons, *changes, *_changed_packages(facts), *stopped]
    if changed is not None and not any(
        "recorded messages" in reason for reason in chain.reasons
    ):
        reasons.insert(0, f"the recording is not the one that was replayed: {changed}")
    return _verdict(chain, changed, effect, frames, reasons, facts.first_frame)


def choice_of(facts: Provenance) -> TrackerChoice:
    """The tracker that the log names, as far as it is installed: a file must not choose freely
    what is imported and called.

    Raises:
        UsageError: it is not.
    """
    try:
        module, colon, _ = facts.tracker.partition(":")
        if colon and module.partition(".")[0] in sys.stdlib_module_names:
            raise UsageError("a module of Python itself")
        choice = choose(facts.tracker, beside=False)
        if colon and not (isinstance(choice.factory, type) and is_tracker(choice.factory)):
            raise UsageError("no class with step, state and restore")
        return choice  # noqa: TRY300
    except UsageError as error:
        named = facts.tracker if ":" in facts.tracker else "module:Class"
        raise UsageError(
            f"{facts.path}: was made with the tracker {facts.tracker!r}"
            f"{facts.tracker_version and f' ({facts.tracker_version})'}, which is not"
            f" installed here ({error}); install it, or, if you trust what is in this"
            f" folder, name it: --tracker {named}"
        ) from error


def _another_tracker(facts: Provenance, choice: TrackerChoice) -> list[str]:
    """That the tracker, its code or the configuration is not what the log says."""
    said: list[str] = []
    if choice.name != facts.tracker and not choice.name.endswith(f":{facts.tracker}"):
        said.append(f"the tracker was {facts.tracker}, is {choice.name}")
    if choice.version != facts.tracker_version:
        then, now = (v or "scenetrace's" for v in (facts.tracker_version, choice.version))
        said.append(f"the code of the tracker {choice.name} was {then}, is {now}")
    if (
        facts.tracker in TRACKER_SECTIONS.get(facts.tracker, ())
        and facts.tracker not in facts.configuration
    ):
        owners = [name for name in TRACKERS if name in facts.configuration]
        others = f", it has those of {' and '.join(owners)}" if owners else ""
        said.append(
            f"the tracker is said to be {facts.tracker}, the configuration has none of its"
            f" parameters{others}: altered"
        )
    return said


def _compared(
    comparing: _Comparing, certain: bool
) -> tuple[ReplayDifference | None, list[str]]:
    """The first effect, and what stopped the replay over an altered recording.

    Raises:
        SceneTraceError: the replay fails, and nothing was altered.
    """
    try:
        return comparing.difference(), []
    except SceneTraceError as error:
        if certain:
            raise
        return None, [f"over what is here a replay stops: {_reason(error)}"]


def _reason(error: SceneTraceError) -> str:
    return error.reason if isinstance(error, RecordingError) else str(error)


def _verdict(
    chain: Verification,
    changed: ReplayDifference | None,
    effect: ReplayDifference | None,
    frames: int,
    reasons: list[str],
    first_frame: int,
) -> Verification:
    difference = changed or effect or chain.difference
    if (
        changed is not None
        and chain.difference is not None
        and WHOLE < chain.difference.frame < changed.frame
    ):
        # Where frames are missing, the chain knows which; the recording only goes on differently
        # after them.
        difference = chain.difference
    if changed is None and effect is not None and chain.difference is not None:
        # The chain's difference has digests for values; the replay's has the values themselves.
        # What belongs to no frame (an altered configuration) is the cause of what differs in
        # frames.
        difference = chain.difference if chain.difference.frame < effect.frame else effect
    if difference is not None and not reasons:
        reasons = [
            "none is known: recording, configuration and packages are as they were; the"
            " code changed without its version, or the tracker is not deterministic"
        ]
    shown = effect if effect is not difference else None
    if difference is not None and difference.frame != WHOLE:
        # Frames may be equal behind a difference that has no effect on them.
        frames = max(0, difference.frame - max(0, first_frame))
    return Verification(
        difference is None, frames, difference, reasons, chain.output_digest, shown
    )


def _changed_packages(facts: Provenance) -> list[str]:
    now = package_versions()
    then = facts.packages
    pairs = [
        (name, then.get(name, "absent"), now.get(name, "absent"))
        for name in sorted({*then, *now})
    ]
    build, today = facts.opencv_build, build_facts(opencv_build())
    pairs += [
        (f"OpenCV's build: {name}", build.get(name, "absent"), today.get(name, "absent"))
        for name in sorted({*build, *today})
    ]
    if facts.python:
        pairs.append(("Python", facts.python, python_version()))
    if facts.machine:
        pairs.append(("the processor", facts.machine, machine()))
    return [f"{name} was {a}, is {b}" for name, a, b in pairs if a != b]


def _scene_of(path: Path, facts: Provenance, given: str | Path | None) -> Path:
    if given is not None:
        return Path(given)
    if facts.whole:
        return path
    # A file name, never a path: what a log says must not lead anywhere else.
    beside = path.with_name(Path(facts.scene).name or "scene.mcap")
    if beside.exists():
        return beside
    raise UsageError(
        f"{path}: does not hold the whole recording, and {beside} is not there; say where"
        " it is with --scene SCENE.mcap"
    )


def _changed_input(
    scene: SceneLog, log: LogReader, facts: Provenance
) -> ReplayDifference | None:
    """Where the recording is not the one whose digests the log has.

    Raises:
        RecordingError: the recording's file is damaged.
    """
    records = recorded_frames(log, facts.camera)
    expected = next(records, None)
    link = digest.START
    count = 0
    frames = scene.frames()
    while True:
        try:
            frame = next(frames, None)
        except RecordingError as error:
            # Bytes that are not what their own file says are damage; content that makes no sense
            # was put there.
            if error.offset is not None or isinstance(error, LimitError):
                raise
            return ReplayDifference(
                count, RECORDED, "", "a frame", f"none that can be read: {error.reason}"
            )
        if frame is None:
            break
        now = digest.recorded_digest(frame.messages)
        link = digest.chain_link(link, now)
        count += 1
        while expected is not None and (
            not expected.digests or expected.digest.frame < frame.index
        ):
            expected = next(records, None)
        if (
            expected is not None
            and expected.digest.frame == frame.index
            and expected.digest.recorded != now
        ):
            return ReplayDifference(
                frame.index,
                RECORDED,
                "digest",
                *short_digests(expected.digest.recorded, now),
            )
        if (
            count == facts.input_frames
            and facts.to_ns is not None
            and link == facts.input_digest
        ):
            return None
    if scene.trailing:
        link = digest.chain_link(link, digest.recorded_digest(scene.trailing))
    if count < facts.input_frames:
        return ReplayDifference(
            WHOLE, RECORDED, "frames", str(facts.input_frames), str(count)
        )
    if link != facts.input_digest:
        return ReplayDifference(
            WHOLE, RECORDED, "input digest", *short_digests(facts.input_digest, link)
        )
    return None


class _Comparing:
    """Holds a new replay against a log.

    Attributes:
        frames: how many frames were equal.
    """

    def __init__(self, run: Run, log: LogReader, facts: Provenance, links: bool) -> None:
        self._run = run
        self._links = links
        self._log = log
        self._facts = facts
        self.frames = 0

    def difference(self) -> ReplayDifference | None:
        """The first difference."""
        facts = self._facts
        records = recorded_frames(self._log, facts.camera)
        expected = next(records, None)
        states = _States(self._log, facts, self._links)
        for now in self._run.frames(keep=states.compare):
            if states.difference is not None:
                return states.difference
            if expected is None or now.frame.time_ns < expected.time_ns:
                if _has_gap(facts, now):
                    return ReplayDifference(
                        now.digest.frame, "frames", "", "no frame", "a frame"
                    )
                if expected is None and now.digest.frame + 1 >= facts.input_frames:
                    break
                continue
            found = _first_difference(expected, now, self._links)
            if found is not None:
                return found
            self.frames += 1
            expected = next(records, None)
            if expected is None and now.digest.frame + 1 >= facts.input_frames:
                break
        if expected is not None:
            number = expected.digest.frame if expected.digests else WHOLE
            return ReplayDifference(number, "frames", "", "a frame", "none")
        return states.difference


def _has_gap(facts: Provenance, now: Annotated) -> bool:
    """A frame of the span that the log should have and has not."""
    first, end = facts.from_ns, facts.to_ns
    time_ns = now.frame.time_ns
    inside = (first is None or time_ns >= first) and (end is None or time_ns < end)
    return inside and now.digest.frame < facts.input_frames


class _States:
    """Holds the log's checkpoints against those of the new replay."""

    def __init__(self, log: LogReader, facts: Provenance, links: bool) -> None:
        self._log = log
        self._links = links
        self._known = facts.checkpoints or {}
        self.difference: ReplayDifference | None = None

    def compare(self, made: Checkpoint) -> None:
        """Compare one, if the log has it."""
        name = checkpoint.name(made.frame)
        if self.difference is not None or name not in self._known:
            return
        for attachment in self._log.attachments([name]):
            try:
                then = checkpoint.decode(attachment.data, str(self._log.path))
            except RecordingError as error:
                self.difference = ReplayDifference(
                    made.frame, name, "", f"a state ({error.reason})", "another"
                )
                return
            self.difference = _unequal_states(name, then, made, self._links)
            if self.difference is not None:
                return


def _unequal_states(
    name: str, then: Checkpoint, now: Checkpoint, links: bool
) -> ReplayDifference | None:
    """Where two checkpoints of one frame differ first. The fingerprint is told of by what is in it.

    Without ``links``, what only says which recording it was is left out.
    """
    for part in ("tracker_state", "reasoner_state"):
        a, b = (checkpoint.encode_state(getattr(c, part)) for c in (then, now))
        if a != b:
            found = first_unequal(checkpoint.decode_state(a), checkpoint.decode_state(b))
            place, old, new = found or ("", "", "")
            return ReplayDifference(now.frame, name, f"{part}.{place}", old, new)
    for field in (
        "frame",
        "time_ns",
        "tracker",
        *(("recorded", "input_link", "link") if links else ()),
    ):
        a, b = getattr(then, field), getattr(now, field)
        if a != b:
            return ReplayDifference(now.frame, name, field, shorten(a), shorten(b))
    return None


def _first_difference(
    then: FrameRecord, now: Annotated, links: bool
) -> ReplayDifference | None:
    """Where a frame as the log has it differs from the one replayed: its values first, then its
    digests.

    ``links`` as well: they hold the recorded messages, so over another recording they differ
    without an effect.
    """
    digest = now.digest
    if then.digests and then.digest.frame != digest.frame:
        return ReplayDifference(
            then.digest.frame, "frames", "number", str(then.digest.frame), str(digest.frame)
        )
    if then.time_ns != now.frame.time_ns:
        return ReplayDifference(
            digest.frame, "frames", "log time", str(then.time_ns), str(now.frame.time_ns)
        )
    for name in channels.ANNOTATED:
        ours = [payload for n, payload in now.payloads if n == name]
        theirs = [payload for n, payload in then.payloads if n == name]
        for a, b in zip_longest(theirs, ours):
            if a != b:
                place, old, new = difference_in(name, a, b)
                return ReplayDifference(digest.frame, name, place, old, new)
    return _unequal_digests(then.digests, digest, links)


def _unequal_digests(
    then: list[Digest], now: Digest, links: bool
) -> ReplayDifference | None:
    """What differs between digests over equal payloads."""
    if len(then) != 1:
        return ReplayDifference(now.frame, "digest", "messages", str(len(then)), "1")
    for name in sorted({*then[0].channels, *now.channels}):
        old, new = (
            digests.get(name, "none") for digests in (then[0].channels, now.channels)
        )
        if old != new:
            return ReplayDifference(now.frame, "digest", name, *short_digests(old, new))
    if links and then[0].link != now.link:
        return ReplayDifference(
            now.frame, "digest", "link", *short_digests(then[0].link, now.link)
        )
    return None
