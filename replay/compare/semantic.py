"""Compare two annotated logs by what they say happened."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from reasoning.questions import Case
from recorders.annotated.provenance import GOLDEN, Provenance, provenance_of
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.corrections import Correction, Corrections
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from replay.compare import words
from replay.compare.activity import Happenings
from replay.compare.bytewise import RECORDING, Raw, compare_bytes
from replay.compare.content import Content, Lasting
from replay.compare.difference import Comparison, Difference
from replay.compare.intervals import Interval, count, intersect, subtract, union
from replay.compare.matching import TrackMatching, TrackPair, ValueChange
from replay.first_difference import shorten, shorten_apart
from replay.plurals import count_of

_INTERVALS = 3
"""So many intervals of frames are named, then the number of the others."""
_READ = ("tracks", "relations", "groups", "events")
# What a difference in a channel shows as; a channel that is not here is told of only where
# nothing else explains it.
_SHOWN_AS = {
    "tracks": ("track", "identity"),
    "relations": ("relation",),
    "groups": ("group",),
    "events": ("event",),
}


@dataclass(frozen=True)
class CompareOptions:
    """What counts as the same.

    Attributes:
        tolerance_px: a matched track's box may be off by so much on each side. 0: every value
            counts; over 0: boxes within it, modes, interaction states, places in the scene,
            events, relations and groups count, and the measured values and pictures beneath them
            do not.
        tolerance_s: an event or an interval's begin may be off by so much and counts as moved,
            not as another one.
        story: compare tracks, relations, groups and events alone: one of them is a golden file.
        only_shared: frames that only one log has are no difference: one of them is a span.
        encounters: compare who was socially together, too.
    """

    tolerance_px: float = 0.0
    tolerance_s: float = 1.0
    only_shared: bool = False
    story: bool = False
    encounters: bool = False


def compare(
    a: str | Path,
    b: str | Path,
    options: CompareOptions | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Comparison:
    """Compare log B with log A.

    Tracks are matched by place, so other numbers are no difference; events by kind, subjects and
    time; relations and groups by their intervals. The logs are read side by side, frame by frame.

    Raises:
        RecordingError: one of them is not an annotated log, or is damaged.
    """
    options = options or CompareOptions()
    with LogReader(a, limits) as left, LogReader(b, limits) as right:
        facts = provenance_of(left), provenance_of(right)
        # Golden files and annotations alone have no recording; of spans, each has a part of its
        # own.
        alike = all(fact.whole and not any(name == GOLDEN for name, _ in log.metadata())
                    for fact, log in zip(facts, (left, right), strict=True))  # fmt: skip
        everything = (
            alike
            and options.tolerance_px == 0
            and not (options.story or options.only_shared)
        )
        raw = compare_bytes(
            left, right, facts[0].camera, facts[1].camera, everything, options.only_shared
        )
    made = _differently_made(*facts)
    if raw.identical:
        return Comparison(str(a), str(b), True, raw.frames, {}, [], made)
    contents = Content(), Content()
    matching = TrackMatching(options.tolerance_px)
    _read(a, b, facts, contents, matching, limits, by_time=raw.frames > 0)
    if options.encounters:
        try:
            both = [
                _encounters(path, fact.camera, content, limits)
                for path, fact, content in zip((a, b), facts, contents, strict=True)
            ]
        except RecordingError as error:
            # Of an altered log the frames can still be told apart, where its tables cannot be made.
            made.append(f"encounters are not compared: {error}")
        else:
            contents[0].encounters, contents[1].encounters = both
    comparer = _Comparer(*contents, matching, options, raw)
    found = comparer.all()
    return Comparison(
        str(a), str(b), False, count(comparer.shared), matching.partner, found, made
    )


def _encounters(
    path: str | Path, camera: str, content: Content, limits: Limits
) -> list[Lasting]:
    """Who was socially together in a log, with the thresholds that questions have."""
    with Case([path], log_limits=limits) as case:
        rows = case.rows(
            "SELECT a, b, kind, start_frame, end_frame FROM encounters"
            " JOIN recordings USING (recording) WHERE camera = ? ORDER BY start_frame, a, b",
            [camera],
        )
    return [
        Lasting(kind, (a, b), content.place(first), content.place(last))
        for a, b, kind, first, last in rows
    ]


def _read(
    a: str | Path,
    b: str | Path,
    facts: tuple[Provenance, Provenance],
    contents: tuple[Content, Content],
    matching: TrackMatching,
    limits: Limits,
    by_time: bool,
) -> None:
    """Read both logs side by side: frames of one time belong together, or of one number where no
    time is common.
    """

    def key(frame: AnnotatedFrame) -> int:
        return frame.time_ns if by_time else frame.index

    with (
        AnnotatedLog(a, facts[0].camera, limits, as_it_is=True) as left,
        AnnotatedLog(b, facts[1].camera, limits, as_it_is=True) as right,
    ):
        for content, log in zip(contents, (left, right), strict=True):
            content.origin_ns = log.start_ns
        ours, theirs = left.frames(_READ), right.frames(_READ)
        x, y = next(ours, None), next(theirs, None)
        place = 0
        while x is not None or y is not None:
            take_x = x is not None and (y is None or key(x) <= key(y))
            take_y = y is not None and (x is None or key(y) <= key(x))
            if x is not None and y is not None and take_x and take_y:
                matching.add(place, x, y)
            if x is not None and take_x:
                contents[0].add(place, x)
                x = next(ours, None)
            if y is not None and take_y:
                contents[1].add(place, y)
                y = next(theirs, None)
            place += 1
    matching.finish()


def _differently_made(a: Provenance, b: Provenance) -> list[str]:
    lines = [f"tracker: {b.tracker}, not {a.tracker}"] if a.tracker != b.tracker else []
    for section in sorted({*a.configuration, *b.configuration}):
        old, new = a.configuration.get(section, {}), b.configuration.get(section, {})
        if a.tracker != b.tracker and (not old or not new):
            continue
        lines += [
            f"parameter: {section}.{name} = {new.get(name, 'absent')}, not"
            f" {old.get(name, 'absent')}"
            for name in sorted({*old, *new})
            if old.get(name) != new.get(name)
            or type(old.get(name)) is not type(new.get(name))
        ]
    lines += _differently_corrected(a.corrections, b.corrections)
    pairs = [
        (name, a.packages.get(name), b.packages.get(name))
        for name in sorted({*a.packages, *b.packages})
    ]
    pairs += [
        (f"OpenCV: {name}", a.opencv_build.get(name), b.opencv_build.get(name))
        for name in sorted(a.opencv_build)
    ]
    return lines + [
        f"version: {name} {new or 'absent'}, not {old or 'absent'}"
        for name, old, new in pairs
        if old != new
    ]


def _how_far(pair: TrackPair, apart: int) -> str:
    """How far two boxes of one target lie from one another, in words."""
    if not apart:
        return f"by up to {pair.largest_px:.3g} px"
    if pair.disjoint >= apart:
        return (
            "without overlap"
            if apart == pair.far + apart
            else f"in {apart} without overlap"
        )
    disjoint = f", in {pair.disjoint} without any" if pair.disjoint else ""
    return f"in {apart} with less than half in common{disjoint}"


def _differently_corrected(a: Corrections | None, b: Corrections | None) -> list[str]:
    """The corrections in force that one log was made with and the other was not."""
    ours, theirs = ([] if c is None else c.in_force for c in (a, b))

    def told(row: Correction) -> str:
        return f"correction {row.correction} ({row.by}): {row.told()}: {row.why}"

    return [told(row) for row in theirs if row not in ours] + [
        f"{told(row)}: no longer" for row in ours if row not in theirs
    ]


class _Comparer:
    def __init__(
        self,
        a: Content,
        b: Content,
        matching: TrackMatching,
        options: CompareOptions,
        raw: Raw,
    ) -> None:
        self.a, self.b = a, b
        self.matching = matching
        self.options = options
        self.raw = raw
        self.strict = options.tolerance_px == 0
        self.shared = intersect(a.frames, b.frames)
        self.happenings = Happenings(
            a, b, self.shared, matching, options.tolerance_s, self.strict
        )

    def all(self) -> list[Difference]:
        """Every difference, by frame."""
        found = [*self._tracks(), *self._identities()]
        found += [] if self.options.only_shared else self._frames()
        found += [
            *self.happenings.events(),
            *self.happenings.relations(),
            *self.happenings.groups(),
            *self.happenings.encounters(),
        ]
        if self.strict and self.options.story:
            found += self._edge_values(
                {
                    (difference.what, *difference.subjects)
                    for difference in found
                    if difference.what == "relation"
                }
            )
        elif self.strict:
            found += self._edge_values(
                {
                    (difference.what, *difference.subjects)
                    for difference in found
                    if difference.what == "relation"
                }
            )
            found += self._recording()
            found += self._messages(found)
        found.sort(
            key=lambda difference: (
                difference.frame,
                difference.what,
                difference.change,
                difference.subjects,
                difference.text,
            )
        )
        return [replace(difference, frame=self._number(difference)) for difference in found]

    def _number(self, difference: Difference) -> int:
        """A difference's frame as the log counts it in which it is to be seen: B for what is only
        there.
        """
        content = (
            self.b
            if difference.what == "frames" and difference.change == "appeared"
            else self.a
        )
        return (
            content.number(difference.frame)
            if content.frames
            else self.b.number(difference.frame)
        )

    # -- frames and tracks
    # -----------------------------------------------------------------------------------------

    def _frames(self) -> Iterator[Difference]:
        for content, other, change, name in (
            (self.a, self.b, "vanished", "A"),
            (self.b, self.a, "appeared", "B"),
        ):
            alone = subtract(content.frames, other.frames)
            if alone:
                first, n = alone[0][0], count(alone)
                numbers = union(
                    (content.number(begin), content.number(end)) for begin, end in alone
                )
                spans = words.intervals(numbers, _INTERVALS)
                text = (
                    f"{n} frame{'s are' if n > 1 else ' is'} in {name} only:"
                    f" frame{'s' if n > 1 else ''} {spans}"
                )
                yield Difference(
                    "frames", change, first, content.seconds(first), [], text, {"frames": n}
                )

    def _tracks(self) -> Iterator[Difference]:
        matching = self.matching
        for track in self.a.tracks:
            if track in matching.partner:
                yield from self._matched(track)
            else:
                here = self._own(self.a, track)
                yield from self._alone(
                    self.a, track, here, "vanished", f"track {track} is not in B"
                )
        for track in self.b.tracks:
            if track not in matching.back:
                here = self._own(self.b, track)
                yield from self._alone(
                    self.b, track, here, "appeared", f"track {track} of B is not in A"
                )
        for (a, b), pair in sorted(matching.pairs.items()):
            within = [] if matching.partner.get(a) == b else matching.followed(a, b)
            if within:
                ours, theirs = (
                    intersect(spans, within)
                    for spans in (self.a.tracks[a], self.b.tracks[b])
                )
                yield from self._pair(a, b, pair, ours, theirs)

    def _own(self, content: Content, track: int) -> list[Interval]:
        """The frames of both logs in which a track of one is its partner of the other, or nobody
        of it.

        Where it is another one, that is told as a change of identity.
        """
        matching = self.matching
        elsewhere = matching.elsewhere_a if content is self.a else matching.elsewhere_b
        return subtract(
            intersect(content.tracks.get(track, []), self.shared), elsewhere.get(track, [])
        )

    @staticmethod
    def _alone(
        content: Content, track: int, here: list[Interval], change: str, text: str
    ) -> Iterator[Difference]:
        n = count(here)
        if n:
            t = content.seconds(here[0][0])
            told = f"{text}: {count_of(n, 'frame')} from {t:.1f} s"
            yield Difference("track", change, here[0][0], t, [track], told, {"frames": n})

    def _matched(self, track: int) -> Iterator[Difference]:
        partner = self.matching.partner[track]
        ours, theirs = self._own(self.a, track), self._own(self.b, partner)
        for mine, other, change, name in (
            (ours, theirs, "vanished", "A"),
            (theirs, ours, "appeared", "B"),
        ):
            alone = subtract(mine, other)
            if alone:
                n, frame = count(alone), alone[0][0]
                t = self.a.seconds(frame)
                text = (
                    f"track {track} is in {count_of(n, 'frame')} of {name} only, first at"
                    f" {t:.1f} s"
                )
                yield Difference(
                    "track",
                    change,
                    frame,
                    t,
                    [track],
                    text,
                    {"frames": n, "partner": partner},
                )
        yield from self._pair(
            track, partner, self.matching.pairs[track, partner], ours, theirs
        )

    def _pair(
        self,
        track: int,
        partner: int,
        pair: TrackPair,
        ours: list[Interval],
        theirs: list[Interval],
    ) -> Iterator[Difference]:
        """How a track of A and the track of B that it is differ while both are there."""
        name = f"track {track}"
        if self.matching.partner.get(track) != partner:
            name += f" (B's track {partner})"
        apart = subtract(intersect(ours, theirs), pair.spans)
        n = pair.far + count(apart)
        if n:
            frame = min(
                [f for f in (pair.first_far, apart[0][0] if apart else -1) if f >= 0]
            )
            t = self.a.seconds(frame)
            text = (
                f"{name} lies elsewhere in {n} of {pair.frames + count(apart)} frames,"
                f" {_how_far(pair, count(apart))}, first at {t:.1f} s"
            )
            details = {
                "frames": n,
                "largest_px": pair.largest_px,
                "frames_apart": count(apart),
                "frames_without_overlap": min(pair.disjoint, count(apart)),
                "partner": partner,
            }
            yield Difference("track", "moved", frame, t, [track], text, details)
        if pair.values:
            yield self._values("track", name, [track], pair.values)

    def _values(
        self, what: str, name: str, subjects: list[int], values: dict[str, ValueChange]
    ) -> Difference:
        """One line for all values of a track or relation that differ: the first one with both
        sides.
        """
        field, first = min(values.items(), key=lambda item: item[1].first)
        t = self.a.seconds(first.first)
        others = f", and {len(values) - 1} more values" if len(values) > 1 else ""
        frames = max(change.frames for change in values.values())
        old, new = shorten_apart(first.a, first.b)
        text = (
            f"{name} has {field} {new}, not {old}, at {t:.1f} s{others}; in"
            f" {count_of(frames, 'frame')}"
        )
        details = {
            n: {
                "frames": value.frames,
                "first": value.first,
                "a": shorten(value.a),
                "b": shorten(value.b),
            }
            for n, value in values.items()
        }
        return Difference(what, "changed", first.first, t, subjects, text, details)

    def _identities(self) -> Iterator[Difference]:
        for before, after in self.matching.changes():
            t = self.a.seconds(after.first)
            if before.a == after.a:
                text = (
                    f"track {after.a} is B's track {after.b} from {t:.1f} s on, B's track"
                    f" {before.b} before"
                )
            else:
                text = (
                    f"B's track {after.b} is track {after.a} from {t:.1f} s on, track"
                    f" {before.a} before"
                )
            details = {"a": [before.a, after.a], "b": [before.b, after.b]}
            yield Difference(
                "identity",
                "changed",
                after.first,
                t,
                sorted({before.a, after.a}),
                text,
                details,
            )

    # -- what only bytes show
    # --------------------------------------------------------------------------------------

    def _edge_values(self, known: set[tuple[str | int, ...]]) -> Iterator[Difference]:
        for (a, b), values in self.matching.edges.items():
            translated = tuple(sorted(self.matching.back.get(track, -1) for track in b))
            if translated == a and ("relation", *a) not in known:
                yield self._values(
                    "relation", f"the relation of {a[0]} and {a[1]}", list(a), values
                )

    def _recording(self) -> Iterator[Difference]:
        first = self.raw.channels.get(RECORDING)
        if first is not None:
            frames = first.frames
            where = f"the recorded messages differ in {count_of(frames, 'frame')}"
            text = (
                f"{where}: another recording, or an altered one ({first.field}: {first.b},"
                f" not {first.a})"
            )
            details = {"frames": frames, "a": first.a, "b": first.b}
            place = self.a.place(first.frame)
            yield Difference(
                "recording", "changed", place, self.a.seconds(place), [], text, details
            )

    def _messages(self, found: list[Difference]) -> Iterator[Difference]:
        """Channels whose bytes differ where nothing above says so. Other track numbers alone
        change bytes, too.
        """
        ids = {*self.a.tracks, *self.b.tracks}
        if any(
            self.matching.partner.get(identity, identity) != identity
            or self.matching.back.get(identity, identity) != identity
            for identity in ids
        ):
            return
        explained = min((difference.frame for difference in found), default=None)
        kinds = {difference.what for difference in found}
        for name, first in self.raw.channels.items():
            shown_as = _SHOWN_AS.get(name)
            place = self.a.place(first.frame)
            covered = explained is not None and explained <= place
            if name == RECORDING or (kinds & set(shown_as) if shown_as else covered):
                continue
            n, t = first.frames, self.a.seconds(place)
            text = (
                f"channel {name}: {first.field} {first.b}, not {first.a}; in"
                f" {count_of(n, 'frame')}"
            )
            details = {
                "channel": name,
                "field": first.field,
                "a": first.a,
                "b": first.b,
                "frames": n,
            }
            yield Difference("message", "changed", place, t, [], text, details)
