"""Patterns over time: sequences of relations, states and events, in one line."""

from reasoning.questions.patterns.atoms import ATOMS
from reasoning.questions.patterns.grammar import Pattern, PatternError, parse
from reasoning.questions.patterns.plan import compile_pattern, plan, shipped_or_given
from reasoning.questions.patterns.shipped import SHIPPED
from reasoning.questions.patterns.symmetry import symmetries

__all__ = [
    "ATOMS",
    "SHIPPED",
    "Pattern",
    "PatternError",
    "compile_pattern",
    "parse",
    "plan",
    "shipped_or_given",
    "symmetries",
]
