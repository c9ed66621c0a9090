"""The loop: one frame in, one scene out. No clock, no randomness.

`Forward` runs a tracker over a scene and keeps the input's digest chain. `Engine` adds the reasoning and travels in
time, for notebooks and debuggers; `replay.replaying` adds hindsight and writing for the command line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from reasoning.reasoner import Reasoner, SceneAnnotation

from recorders.messages import Targets
from recorders.parameters import Config
from recorders.scene import Frame, SceneLog
from replay import digest
from replay.annotate import check_targets
from replay.checkpoint import FORMAT, Checkpoint, decode_state, encode_state
from replay.configuration import DEFAULT_TRACKER, fingerprint, replay_config
from replay.trackers.catalogue import TRACKERS
from replay.trackers.tracker import Tracker, TrackerFactory

Extra = tuple[tuple[str, bytes], ...]


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
    extra: Extra
    recorded: str
    input_link: str
    forward: Targets | None = None
    state: bytes | None = None


class Forward:
    """A tracker's pass over a scene, in order.

    Attributes:
        tracker: the instance that runs.
        input_link: the input chain's link after the last frame.
        previous_ns: the last frame's time, None before the first.
        next_index: the next frame's number.
    """

    def __init__(self, scene: SceneLog, factory: TrackerFactory, config: Config) -> None:
        self.scene = scene
        self.tracker: Tracker = factory(scene.info, config)
        self.input_link = digest.START
        self.previous_ns: int | None = None
        self.next_index = 0

    def resume(self, checkpoint: Checkpoint) -> None:
        """Continue after a checkpoint's frame."""
        self.tracker.restore(checkpoint.tracker_state)
        self.input_link = checkpoint.input_link
        self.previous_ns = checkpoint.time_ns
        self.next_index = checkpoint.frame + 1

    def steps(self, checkpoint_due: Callable[[int], bool] | None = None) -> Iterator[Step]:
        """Run on to the end of the scene; ``checkpoint_due`` says by log time which steps carry a state."""
        start = None if self.previous_ns is None else self.previous_ns + 1
        with Prefetch() as prefetch:
            for frame in prefetch.ahead(self.scene.frames(start, self.next_index)):
                recorded = digest.recorded_digest(frame.messages)
                answer = self.tracker.step(frame)
                check_targets(answer, frame.index)
                self.input_link = digest.chained(self.input_link, recorded)
                self.previous_ns = frame.time_ns
                self.next_index = frame.index + 1
                extra: Extra = getattr(self.tracker, "extra_payloads", tuple)()
                due = checkpoint_due is not None and checkpoint_due(frame.time_ns)
                state = encode_state(self.tracker.state()) if due else None
                yield Step(frame, answer, extra, recorded, self.input_link, None, state)


class Prefetch:
    """Decodes the next frame's picture and mask while this one is tracked.

    Decoding is a pure function of recorded bytes, so threads change the time it takes and nothing else. It starts
    only once a tracker has asked for a picture or a mask: what nobody needs is never decoded.
    """

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="decode")

    def __enter__(self) -> Prefetch:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def ahead(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The same frames, the next one's pictures being decoded meanwhile."""
        previous: Frame | None = None
        current = next(frames, None)
        while current is not None:
            following = next(frames, None)
            if previous is not None:
                # One worker takes them in order, which video packets need.
                for frame in (current, following):
                    if frame is not None:
                        frame.prefetch(self._pool.submit, like=previous)
            yield current
            previous, current = current, following


@dataclass(frozen=True)
class Scene:
    """One frame's whole result."""

    frame: Frame
    targets: Targets
    annotation: SceneAnnotation


class Engine:
    """A replay that steps, pauses and travels in time, without hindsight (which needs the whole recording).

    >>> # engine = Engine(SceneLog("scene.mcap"), "events")
    >>> # scene = engine.step(); engine.seek(12.5); state = engine.state()

    Args:
        scene: the scene log; stays open as long as the engine is used.
        tracker: a tracker's name, or a factory of the caller's own.
        config: as `replay.configuration.replay_config` makes it; defaults without.
        keep_every: a state is kept in memory every so many frames, so that `seek` backwards is quick.
    """

    def __init__(
        self,
        scene: SceneLog,
        tracker: str | TrackerFactory = DEFAULT_TRACKER,
        config: Config | None = None,
        keep_every: int = 50,
    ) -> None:
        self.scene = scene
        self.name = tracker if isinstance(tracker, str) else getattr(tracker, "__name__", type(tracker).__name__)
        self._factory = TRACKERS[tracker] if isinstance(tracker, str) else tracker
        self.config = config or replay_config(tracker if isinstance(tracker, str) else DEFAULT_TRACKER)
        self._keep_every = keep_every
        self._kept: list[bytes] = []
        self._kept_frames: list[int] = []
        self.current: Scene | None = None
        self._begin(None)

    def _begin(self, checkpoint: Checkpoint | None) -> None:
        self._forward = Forward(self.scene, self._factory, self.config)
        self._reasoner = Reasoner(self.config, self.scene.info.width, self.scene.info.height)
        if checkpoint is not None:
            self._forward.resume(checkpoint)
            self._reasoner.restore(checkpoint.reasoner_state)
        self._steps = self._forward.steps()
        self._recorded = ""

    def step(self) -> Scene | None:
        """The next frame's scene, None after the last."""
        taken = next(self._steps, None)
        if taken is None:
            return None
        frame = taken.frame
        annotation = self._reasoner.step(frame.index, frame.time_ns, taken.targets, frame.regions)
        self._recorded = taken.recorded
        self.current = Scene(frame, taken.targets, annotation)
        last_kept = self._kept_frames[-1] if self._kept_frames else -1
        if frame.index % self._keep_every == 0 and frame.index > last_kept:
            self._kept.append(encode_state(self.state()))
            self._kept_frames.append(frame.index)
        return self.current

    def run(self, until_frame: int | None = None) -> Iterator[Scene]:
        """Step on, to a frame (included) or to the end. Stop asking to pause; ask again to go on."""
        while (scene := self.step()) is not None:
            yield scene
            if until_frame is not None and scene.frame.index >= until_frame:
                return

    def seek(self, frame: int) -> Scene:
        """Go to a frame, forwards or backwards; its scene is the same as if reached from 0.

        Raises:
            IndexError: there is no such frame.
        """
        if frame < 0:
            raise IndexError(f"frame {frame}")
        if self.current is None or frame <= self.current.frame.index:
            before = [k for k, kept in enumerate(self._kept_frames) if kept < frame]
            self._steps.close()  # type: ignore[attr-defined]
            self._begin(self._checkpoint(decode_state(self._kept[before[-1]])) if before else None)
        for scene in self.run(frame):
            if scene.frame.index == frame:
                return scene
        raise IndexError(f"frame {frame}: the scene ends at frame {self._forward.next_index - 1}")

    def state(self) -> dict[str, Any]:
        """The whole state after the last frame, as plain data; `restore` takes it."""
        if self.current is None:
            raise IndexError("no frame yet; step() first")
        return {
            "version": FORMAT,
            "frame": self.current.frame.index,
            "time_ns": self.current.frame.time_ns,
            "recorded": self._recorded,
            "input_link": self._forward.input_link,
            "link": "",
            "tracker": self.name,
            "fingerprint": fingerprint(self.name, self.config),
            "tracker_state": self._forward.tracker.state(),
            "reasoner_state": self._reasoner.state(),
        }

    @staticmethod
    def _checkpoint(state: dict[str, Any]) -> Checkpoint:
        return Checkpoint(**state)

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._steps.close()  # type: ignore[attr-defined]
        self._begin(self._checkpoint(decode_state(encode_state(state))))
        self.current = None
