"""What `import scenetrace` offers beyond the rooms' own functions: opened logs, answers, verbs."""

from replay.library.answers import Rows, ask, query
from replay.library.opened import OpenLog, SceneFrame, graph_of
from replay.library.supervision import to_detections
from replay.library.verbs import evaluate, record, replay

__all__ = [
    "OpenLog",
    "Rows",
    "SceneFrame",
    "ask",
    "evaluate",
    "graph_of",
    "query",
    "record",
    "replay",
    "to_detections",
]
