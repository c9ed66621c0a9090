"""Which tracker: the one answer that replaying, writing, verifying and configuring go by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from recorders import plugins
from recorders.errors import SceneTraceError
from recorders.parameters import Parameters
from replay.trackers.catalogue import TRACKER_SECTIONS, TRACKERS
from replay.trackers.tracker import TrackerFactory

DEFAULT_TRACKER = "events"


@dataclass(frozen=True)
class TrackerChoice:
    """A tracker, with everything that a log says of it.

    A foreign tracker declares by attributes of its class (or function): ``SECTIONS``, section
    name to `Parameters` class, without which it has no parameters; and whether it wants hindsight
    (see `wants_hindsight`).

    Attributes:
        name: leads to it again: a catalogue's name, an entry point's, or ``module:Class``. The
            bare class's name where nothing leads to it (it was made inside a function).
        factory: what makes it.
        sections: its own parameters.
        version: of its code, see `recorders.plugins.version_of`; empty for the catalogue's, whose
            version is scenetrace's.
    """

    name: str
    factory: TrackerFactory
    sections: Mapping[str, type[Parameters]] = field(default_factory=dict)
    version: str = ""

    @property
    def title(self) -> str:
        """The name without its module, for sentences."""
        return self.name.rpartition(":")[2]

    @property
    def foreign(self) -> bool:
        """It is not one of scenetrace's."""
        return self.name not in TRACKERS or TRACKERS[self.name] is not self.factory

    def wants_hindsight(self, config: Mapping[str, Parameters]) -> bool:
        """Whether the hindsight step follows the forward pass: as a parameter ``hindsight`` in
        one of its sections says, else as its attribute ``HINDSIGHT``, else not.
        """
        for section in self.sections:
            said = getattr(config.get(section), "hindsight", None)
            if said is not None:
                return bool(said)
        return bool(_declared(self.factory, "HINDSIGHT", False))


AnyTracker = str | TrackerFactory | TrackerChoice
"""A name, what makes a tracker, or what `choose` made of either."""


def choose(tracker: AnyTracker = DEFAULT_TRACKER, *, beside: bool = True) -> TrackerChoice:
    """The tracker that is meant.

    Args:
        tracker: a name of the catalogue, an entry point of the group ``scenetrace.trackers``,
            ``module:Class``, or a class (or function) itself.
        beside: as in `recorders.plugins.load`.

    Raises:
        UsageError: there is none.
        SceneTraceError: it cannot be imported, or its ``SECTIONS`` are none.
    """
    if isinstance(tracker, TrackerChoice):
        return tracker
    if isinstance(tracker, str):
        if tracker in TRACKERS:
            return TrackerChoice(tracker, TRACKERS[tracker], TRACKER_SECTIONS[tracker])
        plugin = plugins.load(plugins.TRACKERS, tracker, TRACKERS, beside=beside)
        return _foreign(plugin.name, plugin.value, plugin.version)
    own = next((name for name, made in TRACKERS.items() if made is tracker), None)
    if own is not None:
        return choose(own)
    plain = plugins.unbound(tracker)
    bare = getattr(plain, "__name__", type(plain).__name__)
    name = plugins.address_of(tracker) or str(bare)
    return _foreign(name, tracker, plugins.version_of(tracker))


def _foreign(name: str, factory: Any, version: str) -> TrackerChoice:
    if not callable(factory):
        raise SceneTraceError(
            f"the tracker {name} is {type(factory).__name__}: must be a class or function"
            " that takes a scene's description and a configuration"
        )
    sections = _declared(factory, "SECTIONS", {})
    if not isinstance(sections, Mapping) or not all(
        isinstance(kind, type) and issubclass(kind, Parameters)
        for kind in sections.values()
    ):
        raise SceneTraceError(
            f"the tracker {name}: SECTIONS must be a dict of section names to classes of"
            " recorders.parameters.Parameters"
        )
    return TrackerChoice(name, factory, sections, version)


def _declared(factory: Any, name: str, otherwise: Any) -> Any:
    return getattr(factory, name, getattr(plugins.unbound(factory), name, otherwise))
