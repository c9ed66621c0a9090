"""The digest chain: any change of any part shows, order and boundaries included."""

from __future__ import annotations

from recorders.annotated import digest


def test_payload_boundaries_and_order_count() -> None:
    one = digest.channel_digests([("events", b"ab"), ("events", b"c")])
    other = digest.channel_digests([("events", b"a"), ("events", b"bc")])
    swapped = digest.channel_digests([("events", b"c"), ("events", b"ab")])
    assert len({one["events"], other["events"], swapped["events"]}) == 3


def test_channels_are_independent_of_their_interleaving() -> None:
    a = digest.channel_digests([("tracks", b"t"), ("events", b"e"), ("groups", b"g")])
    b = digest.channel_digests([("groups", b"g"), ("tracks", b"t"), ("events", b"e")])
    assert a == b
    assert list(a) == sorted(a)


def test_every_part_of_a_link_counts() -> None:
    base = digest.digest(digest.START, 3, 100, "r", [("tracks", b"t")])
    changed = [
        digest.digest("1" * 64, 3, 100, "r", [("tracks", b"t")]),
        digest.digest(digest.START, 4, 100, "r", [("tracks", b"t")]),
        digest.digest(digest.START, 3, 101, "r", [("tracks", b"t")]),
        digest.digest(digest.START, 3, 100, "s", [("tracks", b"t")]),
        digest.digest(digest.START, 3, 100, "r", [("tracks", b"u")]),
        digest.digest(digest.START, 3, 100, "r", [("groups", b"t")]),
        digest.digest(digest.START, 3, 100, "r", []),
    ]
    assert base.link not in {d.link for d in changed}
    assert len({d.link for d in changed}) == len(changed)
    assert digest.digest(digest.START, 3, 100, "r", [("tracks", b"t")]) == base
