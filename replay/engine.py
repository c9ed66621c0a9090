"""The loop: one frame in, one scene out. No clock, no randomness.

`Forward` runs a tracker over a scene and keeps the input's digest chain. `Engine` adds the
reasoning and travels in time, for notebooks and debuggers; `replay.run` adds hindsight and
writing for the command line.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from typing import Any

import msgspec
import numpy as np

from reasoning.reasoner import Reasoner, SceneAnnotation
from recorders.annotated import digest
from recorders.annotated.checkpoint import FORMAT, Checkpoint, decode_state, encode_state
from recorders.errors import SceneTraceError, UsageError
from recorders.log import Message
from recorders.messages import Targets
from recorders.parameters import Config
from recorders.scene import Frame, SceneLog
from replay.configuration import fingerprint, replay_config
from replay.protocol import check_targets, code_of, make_tracker
from replay.trackers.choice import DEFAULT_TRACKER, AnyTracker, choose
from replay.trackers.tracker import Payloads, PayloadTracker, Tracker

NANOS = 1_000_000_000
_MOST_KEPT = 64
AHEAD = 4
"""Frames that are made ready before they are tracked: what tracking takes differs from frame to
frame.
"""
_WORTH_A_THREAD = 16 << 10
"""Bytes that take longer to hash than to hand to another thread."""


@contextmanager
def continuing(after_frame: int | None) -> Iterator[None]:
    """Whatever goes wrong after a state was restored is said to come from it: states are read
    from files.

    Raises:
        SceneTraceError: in place of any other exception, where ``after_frame`` says that a state
            was restored.
    """
    try:
        yield
    except SceneTraceError:
        raise
    except Exception as error:
        if after_frame is None:
            raise
        raise SceneTraceError(
            f"cannot continue from the state after frame {after_frame} ({type(error).__name__}:"
            f" {error}): it is damaged or of another version; replay without it"
        ) from error


@dataclass(frozen=True)
class Step:
    """One frame after the forward pass.

    Attributes:
        frame: what went in.
        targets: what the tracker said, or what hindsight made of it.
        extra: payloads of channels of the tracker's own.
        recorded: the digest of the frame's recorded messages.
        input_link: the input chain's link.
        forward: what the tracker said, where hindsight rewrote it.
        state: the tracker's encoded state after the frame, where a checkpoint is due.
    """

    frame: Frame
    targets: Targets
    extra: Payloads
    recorded: str
    input_link: str
    forward: Targets | None = None
    state: bytes | None = None


def recorded_now(frame: Frame) -> str:
    """The digest of what was recorded at the frame's very time."""
    return digest.recorded_digest(
        message for message in frame.messages if message.log_time_ns == frame.time_ns
    )


def of_recording(scene: SceneLog, checkpoint: Checkpoint) -> bool:
    """Whether a checkpoint's last frame is the scene's frame of that time, as it was recorded."""
    frame = next(scene.frames(checkpoint.time_ns, checkpoint.frame), None)
    return (
        frame is not None
        and frame.time_ns == checkpoint.time_ns
        and recorded_now(frame) == checkpoint.recorded
    )


class Forward:
    """A tracker's pass over a scene, in order.

    Attributes:
        tracker: the instance that runs.
        input_link: the input chain's link after the last frame.
        previous_ns: the last frame's time, None before the first.
        next_index: the next frame's number.
    """

    def __init__(
        self,
        scene: SceneLog,
        tracker: AnyTracker,
        config: Config,
        *,
        unfinished: bool = False,
    ) -> None:
        self.scene = scene
        self._choice = choose(tracker)
        self.tracker: Tracker = make_tracker(self._choice, scene.info, config)
        self._payloads: Callable[[], Payloads] = tuple
        if isinstance(self.tracker, PayloadTracker):
            self._payloads = partial(self.tracker.extra_payloads, finished=not unfinished)
        self.input_link = digest.START
        self.previous_ns: int | None = None
        self.next_index = 0
        self._resumed: int | None = None

    def resume(self, checkpoint: Checkpoint) -> None:
        """Continue after a checkpoint's frame.

        Raises:
            SceneTraceError: the tracker does not take its state, or not the whole of it.
        """
        with continuing(checkpoint.frame):
            self.tracker.restore(checkpoint.tracker_state)
            taken = encode_state(self.tracker.state())
        if taken != encode_state(checkpoint.tracker_state):
            raise SceneTraceError(
                f"the tracker restored from the state after frame {checkpoint.frame} has"
                " another state(): the state is damaged, or restore() does not take up"
                " everything that state() gives"
            )
        self._resumed = checkpoint.frame
        self.input_link = checkpoint.input_link
        self.previous_ns = checkpoint.time_ns
        self.next_index = checkpoint.frame + 1

    def steps(self, checkpoint_due: Callable[[int], bool] | None = None) -> Generator[Step]:
        """Run on to the end of the scene; ``checkpoint_due`` says by log time which steps carry a
        state.
        """
        start = None if self.previous_ns is None else self.previous_ns + 1
        # Who waits for the next frames of a log that grows would be behind by as many.
        with Prefetch(1 if self.scene.grows else AHEAD) as prefetch:
            for frame, hashed in prefetch.ahead(self.scene.frames(start, self.next_index)):
                try:
                    answer = self.tracker.step(frame)
                except Exception:
                    where = f"frame {frame.index}: "
                    with code_of(self._choice, where), continuing(self._resumed):
                        raise
                check_targets(answer, frame.index)
                recorded = hashed()
                self.input_link = digest.chain_link(self.input_link, recorded)
                self.previous_ns = frame.time_ns
                self.next_index = frame.index + 1
                extra = self._payloads()
                due = checkpoint_due is not None and checkpoint_due(frame.time_ns)
                state = self._state() if due else None
                yield Step(frame, answer, extra, recorded, self.input_link, None, state)

    def _state(self) -> bytes:
        try:
            return encode_state(self.tracker.state())
        except TypeError as error:
            raise SceneTraceError(
                f"the tracker's state(): {error}; it must be plain data and arrays of numbers"
            ) from error


class Prefetch:
    """Decodes and hashes the next frame while this one is tracked.

    Both are pure functions of recorded bytes, so threads change the time they take and nothing
    else. Decoding starts only once a tracker has asked for a picture or a mask: what nobody needs
    is never decoded.
    """

    def __init__(self, depth: int = AHEAD) -> None:
        self._depth = depth
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="decode")

    def __enter__(self) -> Prefetch:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def ahead(self, frames: Iterator[Frame]) -> Iterator[tuple[Frame, Callable[[], str]]]:
        """The same frames, each with what gives its `recorded_digest`, the next few being made
        ready meanwhile.

        What goes wrong in reading ahead is raised once the frames before it have been given out.
        """
        waiting: deque[tuple[Frame, Callable[[], str]]] = deque()
        tracked: Frame | None = None
        failed: Exception | None = None
        ended = False
        while True:
            while not ended and len(waiting) < self._depth:
                try:
                    frame = next(frames, None)
                except Exception as error:
                    frame, failed = None, error
                if frame is None:
                    ended = True
                else:
                    waiting.append((frame, self._hash(frame.messages)))
            if not waiting:
                break
            if tracked is not None:
                # One worker takes them in order, which video packets need.
                for frame, _ in waiting:
                    frame.prefetch(self._pool.submit, like=tracked)
            tracked, hashed = waiting.popleft()
            yield tracked, hashed
        if failed is not None:
            raise failed

    def _hash(self, messages: tuple[Message, ...]) -> Callable[[], str]:
        if sum(len(message.data) for message in messages) < _WORTH_A_THREAD:
            return partial(digest.recorded_digest, messages)
        return self._pool.submit(digest.recorded_digest, messages).result


@dataclass(frozen=True)
class FrameResult:
    """One frame's whole result."""

    frame: Frame
    targets: Targets
    annotation: SceneAnnotation


class Engine:
    """A replay that steps, pauses and travels in time, without hindsight (which needs the whole
    recording).

    >>> # engine = Engine(SceneLog("scene.mcap"), "events")
    >>> # scene = engine.step(); engine.seek(12.5); state = engine.state()

    Args:
        scene: the scene log; stays open as long as the engine is used.
        tracker: a tracker's name, or a class of the caller's own.
        config: as `replay.configuration.replay_config` makes it; defaults without.
        keep_every: a state is kept in memory every so many frames, so that `seek` backwards is
            quick; over a long recording they are thinned out, so that no more than 64 are held.

    Attributes:
        current: the scene after the last step; None before the first and right after `restore`.

    Raises:
        UsageError: no such tracker.
    """

    def __init__(
        self,
        scene: SceneLog,
        tracker: AnyTracker = DEFAULT_TRACKER,
        config: Config | None = None,
        keep_every: int = 50,
    ) -> None:
        self.scene = scene
        self._choice = choose(tracker)
        self.name = self._choice.name
        self.config = config or replay_config(self._choice)
        self._fingerprint = fingerprint(self._choice, self.config)
        self._keep_every = max(keep_every, 1)
        self._kept: dict[int, bytes] = {}
        self._paused = False
        self._steps: Generator[Step] | None = None
        self.current: FrameResult | None = None
        self._begin(None)

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        """Go to the start or to a checkpoint; where that fails, the engine is where it was."""
        forward = Forward(self.scene, self._choice, self.config)
        reasoner = Reasoner(self.config, self.scene.info.width, self.scene.info.height)
        if checkpoint is not None:
            forward.resume(checkpoint)
            with continuing(checkpoint.frame):
                reasoner.restore(checkpoint.reasoner_state)
        if self._steps is not None:
            self._steps.close()
        self._forward, self._reasoner, self._restored = forward, reasoner, checkpoint
        self._steps = forward.steps()
        self.current = None

    def step(self) -> FrameResult | None:
        """The next frame's scene, None after the last."""
        taken = None if self._steps is None else next(self._steps, None)
        if taken is None:
            return None
        frame = taken.frame
        with continuing(None if self._restored is None else self._restored.frame):
            annotation = self._reasoner.step(
                frame.index,
                frame.time_ns,
                taken.targets,
                frame.regions,
                frame.detections,
                scene_changes=frame.changes,
            )
        self.current = FrameResult(frame, taken.targets, annotation)
        if frame.index % self._keep_every == 0 and frame.index not in self._kept:
            self._keep(frame.index)
        return self.current

    def _keep(self, index: int) -> None:
        self._kept[index] = encode_state(self.state())
        if len(self._kept) > _MOST_KEPT:
            self._keep_every *= 2
            self._kept = {
                k: state for k, state in self._kept.items() if k % self._keep_every == 0
            }

    def run(self, until_frame: int | None = None) -> Iterator[FrameResult]:
        """Step on, to a frame (included) or to the end. Stop asking, or `pause`, to halt; ask
        again to go on.
        """
        self._paused = False
        while not self._paused and (scene := self.step()) is not None:
            yield scene
            if until_frame is not None and scene.frame.index >= until_frame:
                return

    def pause(self) -> None:
        """End a `run` after the frame that it is at, from whatever thread; `run` again goes on."""
        self._paused = True

    def seek(self, where: int | float) -> FrameResult:
        """Go somewhere, forwards or backwards; the scene is the same as if reached from 0.

        Args:
            where: a frame's number as an int, or a time in seconds from the recording's start as
                a float (numpy's ints and floats as well): the last frame at or before it.

        Raises:
            IndexError: there is no such frame.
            TypeError: ``where`` is no number.
        """
        frame = self._frame_number(where)
        if frame < 0:
            raise IndexError(f"frame {frame}: frames count from 0")
        here = self._forward.next_index - 1
        if self.current is not None and here == frame:
            return self.current
        if frame <= here:
            before = max((k for k in self._kept if k < frame), default=None)
            self._begin(
                None if before is None else _from_state(decode_state(self._kept[before]))
            )
        while (scene := self.step()) is not None:
            if scene.frame.index == frame:
                return scene
        raise IndexError(
            f"frame {frame}: the scene ends at frame {self._forward.next_index - 1}"
        )

    def _frame_number(self, where: Any) -> int:
        if isinstance(where, Integral):
            return int(where)
        if isinstance(where, float | np.floating):
            return self._frame_at(float(where))
        raise TypeError(
            f"{where!r}: must be a frame's number as an int, or seconds as a float"
        )

    def _frame_at(self, seconds: float) -> int:
        if not math.isfinite(seconds):
            raise IndexError(f"{seconds} s: no time of the scene")
        times = self.scene.frame_times()
        first = next(times)
        limit_ns = first + round(seconds * NANOS)
        if limit_ns < first:
            raise IndexError(f"{seconds} s: the scene starts at 0 s")
        frame = 0
        for time_ns in times:
            if time_ns > limit_ns:
                break
            frame += 1
        return frame

    def state(self) -> dict[str, Any]:
        """The whole state after the last frame, as plain data; `restore` takes it.

        Raises:
            IndexError: there was no frame yet.
        """
        if self._forward.previous_ns is None:
            raise IndexError("no frame yet; step() first")
        return {
            "version": FORMAT,
            "frame": self._forward.next_index - 1,
            "time_ns": self._forward.previous_ns,
            "recorded": self._last_recorded(),
            "input_link": self._forward.input_link,
            "link": "",
            "tracker": self.name,
            "fingerprint": self._fingerprint,
            "tracker_state": self._forward.tracker.state(),
            "reasoner_state": self._reasoner.state(),
        }

    def _last_recorded(self) -> str:
        if self.current is not None:
            return recorded_now(self.current.frame)
        return "" if self._restored is None else self._restored.recorded

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` gave, in this or in another engine of the same scene and
        configuration.

        Raises:
            UsageError: it is of another tracker, configuration, version or recording.
            SceneTraceError: it is damaged. The engine stays where it was, as it does after any of
                these.
        """
        checkpoint = _from_state(decode_state(encode_state(state)))
        if checkpoint.version != FORMAT:
            raise UsageError(
                f"a state of format {checkpoint.version}; this scenetrace reads {FORMAT}"
            )
        if (checkpoint.tracker, checkpoint.fingerprint) != (self.name, self._fingerprint):
            raise UsageError(
                f"a state of tracker {checkpoint.tracker!r}, for an engine of"
                f" {self.name!r}: tracker, configuration and package versions must be the"
                " same"
            )
        if not of_recording(self.scene, checkpoint):
            raise UsageError(f"a state of another recording than {self.scene.path}")
        self._begin(checkpoint)


def _from_state(state: Any) -> Checkpoint:
    try:
        return msgspec.convert(state, Checkpoint)
    except msgspec.ValidationError as error:
        raise SceneTraceError(f"not a state of an engine: {error}") from error
