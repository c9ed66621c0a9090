"""Questions to annotated logs: tables, SQL, ready questions, patterns."""

from reasoning.questions.asking import Answer, QueryError, QueryLimits
from reasoning.questions.case import Case
from reasoning.questions.schema import CONTRACT, TABLES

__all__ = ["CONTRACT", "TABLES", "Answer", "Case", "QueryError", "QueryLimits"]
