"""How dense the code is, counted: `python tests/measures.py [--all]`.

Tokens per line of code (docstrings, comments and blank lines are no code), the share of names with
one letter among all that are bound (parameters, targets of assignments, loops and comprehensions,
`as`), files and functions that are long, classes that share a name, functions and calls
with eight or more arguments by position. `tests/test_measures.py` holds the bars.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("recorders", "reasoning", "replay", "fixtures")
LONG_FILE = 400
LONG_FUNCTION = 40
MANY_ARGUMENTS = 8
_NO_CODE = frozenset(
    {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    }
)
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Measures:
    """What was counted over some files."""

    tokens: int = 0
    lines: int = 0
    names: int = 0
    one_letter: Counter[str] = field(default_factory=Counter)
    by_file: Counter[str] = field(default_factory=Counter)
    long_files: list[str] = field(default_factory=list)
    long_functions: list[str] = field(default_factory=list)
    many_arguments: list[str] = field(default_factory=list)
    classes: dict[str, list[str]] = field(default_factory=dict)

    @property
    def tokens_a_line(self) -> float:
        """Tokens per line of code."""
        return self.tokens / max(1, self.lines)

    @property
    def one_letter_share(self) -> float:
        """The share of bound names that have one letter; ``_`` is none."""
        return self.one_letter.total() / max(1, self.names)

    @property
    def shared_classes(self) -> dict[str, list[str]]:
        """Names of classes that stand in more than one file."""
        return {name: at for name, at in sorted(self.classes.items()) if len(at) > 1}


def _docstring_lines(tree: ast.Module) -> set[int]:
    """Lines of strings that stand alone: docstrings, and those below a constant."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            lines.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def _code_tokens(text: str, tree: ast.Module) -> Iterator[tokenize.TokenInfo]:
    outside = _docstring_lines(tree)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE and token.start[0] not in outside:
            yield token


def _bound_names(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.ExceptHandler) and node.name:
            yield node.name
        elif isinstance(node, ast.alias) and node.asname:
            yield node.asname


def _positional(function: Function) -> int:
    given = [*function.args.posonlyargs, *function.args.args]
    return sum(argument.arg not in ("self", "cls") for argument in given)


@cache
def _of(text: str, where: str) -> Measures:
    """Of one file; nobody changes it. The same files are measured in several groups."""
    found = Measures()
    tree = ast.parse(text)
    lines: set[int] = set()
    for token in _code_tokens(text, tree):
        found.tokens += 1
        lines.update(range(token.start[0], token.end[0] + 1))
    found.lines = len(lines)
    bound = [name for name in _bound_names(tree) if name != "_"]
    found.names = len(bound)
    short = [name for name in bound if len(name) == 1]
    found.one_letter.update(short)
    found.by_file[where] = len(short)
    if text.count("\n") > LONG_FILE:
        found.long_files.append(f"{where} {text.count(chr(10))}")
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            found.classes.setdefault(node.name, []).append(where)
        if isinstance(node, ast.Call) and len(node.args) >= MANY_ARGUMENTS:
            called = ast.unparse(node.func)
            found.many_arguments.append(
                f"{where}:{node.lineno} {called}() {len(node.args)}"
            )
        if not isinstance(node, Function):
            continue
        size = (node.end_lineno or node.lineno) - node.lineno + 1
        place = f"{where}:{node.lineno} {node.name}"
        if size > LONG_FUNCTION:
            found.long_functions.append(f"{place} {size}")
        if _positional(node) >= MANY_ARGUMENTS:
            found.many_arguments.append(f"{place} {_positional(node)}")
    return found


def measure(files: list[Path]) -> Measures:
    """Count over Python files."""
    whole = Measures()
    for path in files:
        one = _of(path.read_text(encoding="utf-8"), str(path.relative_to(ROOT)))
        whole.tokens += one.tokens
        whole.lines += one.lines
        whole.names += one.names
        whole.one_letter.update(one.one_letter)
        whole.by_file.update(one.by_file)
        whole.long_files += one.long_files
        whole.long_functions += one.long_functions
        whole.many_arguments += one.many_arguments
        for name, at in one.classes.items():
            whole.classes.setdefault(name, []).extend(at)
    return whole


def product_files() -> list[Path]:
    """The files of all rooms."""
    return sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))


def main() -> None:
    """Print the measures of the product, of each room, and of the tests."""
    every = product_files()
    groups = {"product": every}
    groups |= {room: [p for p in every if p.is_relative_to(ROOT / room)] for room in ROOMS}
    groups["tests"] = sorted((ROOT / "tests").rglob("*.py"))
    for name, files in groups.items():
        m = measure(files)
        print(
            f"{name:10} {len(files):4} files {m.lines:6} lines of code"
            f" {m.tokens_a_line:5.2f} tokens a line {m.one_letter_share:6.1%} one letter"
            f" {len(m.long_files):3} long files {len(m.long_functions):4} long functions"
            f" {len(m.shared_classes):3} shared classes {len(m.many_arguments):3} with many"
            " arguments"
        )
    if "--all" in sys.argv[1:]:
        m = measure(every)
        for title, rows in (
            ("files over 400 lines", m.long_files),
            ("functions over 40 lines", m.long_functions),
            ("eight or more arguments by position", m.many_arguments),
            ("classes", [f"{k}: {', '.join(v)}" for k, v in m.shared_classes.items()]),
            ("one letter", [f"{k} {v}" for k, v in m.one_letter.most_common()]),
            ("one letter by file", [f"{k} {v}" for k, v in m.by_file.most_common(60)]),
        ):
            print(f"\n{title} ({len(rows)})")
            print("\n".join(rows))


if __name__ == "__main__":
    main()
