"""What is not sure enough is left out of a ready question's answer, and counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from reasoning.questions.asking import Answer
from reasoning.questions.case import Case
from reasoning.questions.question import Options
from reasoning.questions.ready_questions import (
    DEFAULT_CERTAINTY,
    question,
    unsure_contacts_sql,
)
from recorders.errors import UsageError

__all__ = ["Unsure", "wanted_certainty"]


def wanted_certainty(name: str, given: float | None, called: str) -> float | None:
    """How sure a question's rows must be; None where it is asked however sure they are.

    Args:
        name: the question's.
        given: what was asked for, if anything was.
        called: the option's name, for the error.

    Raises:
        UsageError: no probability, or no such question.
    """
    if given is None:
        return DEFAULT_CERTAINTY if question(name).certain else None
    if not 0 <= given <= 1:
        raise UsageError(f"{called} {given:g}: must be 0 to 1")
    return float(given)


class Unsure:
    """Leaves rows out of an answer that are less sure than wanted, and counts them.

    Attributes:
        least: how sure a row must be; None: all are kept.
        count: rows left out so far: they are counted as they are read.
    """

    def __init__(self, least: float | None) -> None:
        self.least = least
        self.count = 0

    def left_out_of(self, answer: Answer) -> Answer:
        """The answer without them."""
        if self.least is None or "certainty" not in answer.columns:
            return answer
        column = answer.columns.index("certainty")
        return replace(answer, rows=self._sure(answer.rows, column, self.least))

    def _sure(
        self, rows: Iterator[tuple[Any, ...]], column: int, least: float
    ) -> Iterator[tuple[Any, ...]]:
        for row in rows:
            if row[column] is not None and row[column] < least:
                self.count += 1
            else:
                yield row

    def add_contacts(self, case: Case, name: str, options: Options) -> None:
        """Chains of contacts do not run over unsure ones, so these are counted by themselves."""
        if self.least is not None and name == "contacts":
            self.count += case.rows(unsure_contacts_sql(options))[0][0]

    def told(self) -> str:
        """What was left out, in a line of the command."""
        rows = "1 row is" if self.count == 1 else f"{self.count} rows are"
        return (
            f"{rows} less sure than {self.least:g} and left out; --certainty 0 shows all,"
            " with how sure each is"
        )
