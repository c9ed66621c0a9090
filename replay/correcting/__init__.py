"""A person's corrections, applied to tracks before anything is reasoned out of them."""

from replay.correcting.book import Book
from replay.correcting.corrector import Corrector
from replay.correcting.files import opened, written
from replay.correcting.making import Wish, add, take_back

__all__ = ["Book", "Corrector", "Wish", "add", "opened", "take_back", "written"]
