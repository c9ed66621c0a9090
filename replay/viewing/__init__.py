"""The report over HTTP, with the whole recording behind it; for this machine alone."""

from replay.viewing.desk import Desk
from replay.viewing.server import DeskServer

__all__ = ["Desk", "DeskServer"]
