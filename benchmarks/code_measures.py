"""Measure the package itself: sizes, annotations, anonymous tuples, untyped compiled calls.

The table in CONTRIBUTING.md is made by this script; it reads sources and runs nothing.
`--package DIR` measures another checkout; `--quick` leaves the repeated statements out.
"""

from __future__ import annotations

import ast
import io
import statistics
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from _common import arguments, report

PACKAGE = Path(__file__).resolve().parents[1] / "mottrack"
PLAIN = (0, 1, -1, 2, 0.5, 1.0, 0.0, 2.0, -1.0, 1e-9, 1e9, 1e3, 1e-3, 100)
"""Numbers that need no reason: identities, halves and conversions of units."""
REPEATED_LINES = 8
"""Length of a run of equal statements that counts as a duplicate."""


class Function(NamedTuple):
    """One function of the package."""

    file: Path
    node: ast.FunctionDef | ast.AsyncFunctionDef

    @property
    def parameters(self) -> list[ast.arg]:
        a = self.node.args
        return [x for x in (*a.posonlyargs, *a.args, *a.kwonlyargs) if x.arg not in ("self", "cls")]

    @property
    def body_lines(self) -> int:
        body = self.node.body
        documented = ast.get_docstring(self.node) is not None
        first = body[0].end_lineno + 1 if documented else body[0].lineno
        return max(self.node.end_lineno - first + 1, 0)


def measure(package: Path, *, find_repeated: bool) -> dict[str, float | int]:
    """Every figure of the table, by its name."""
    texts = {path: path.read_text() for path in sorted(package.rglob("*.py"))}
    trees = {path: ast.parse(text) for path, text in texts.items()}
    lines = [text.count("\n") for text in texts.values()]
    functions = [Function(p, n) for p, tree in trees.items() for n in ast.walk(tree)
                 if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]  # fmt: skip
    bodies = [f.body_lines for f in functions]
    public = [f for f in functions if not f.node.name.startswith("_")]
    constants = [c for p in texts for c in unexplained(texts[p], trees[p])]
    figures: dict[str, float | int] = {
        "files": len(lines),
        "lines": sum(lines),
        "lines of code (without docstrings, comments, blanks)": sum(
            code_lines(texts[p], trees[p]) for p in texts
        ),
        "file lines, median": int(statistics.median(lines)),
        "file lines, p90": percentile(lines, 90),
        "files under 20 lines, __init__ apart": sum(
            n < 20 and path.name not in ("__init__.py", "__main__.py")
            for path, n in zip(texts, lines, strict=True)
        ),
        "functions": len(functions),
        "body lines, median": int(statistics.median(bodies)),
        "body lines, p90": percentile(bodies, 90),
        "body lines, max": max(bodies),
        "arguments, max": max(len(f.parameters) for f in functions),
        "annotated, %": share(annotated(f) for f in functions),
        "documented (public), %": share(ast.get_docstring(f.node) is not None for f in public),
        "anonymous tuple parameters": sum(
            anonymous(x.annotation) for f in functions for x in f.parameters
        ),
        "untyped compiled functions": sum(bool(untyped_compiled(f)) for f in functions),
        "constants without a reason": len(constants),
        "comment lines, %": round(100 * sum(map(comments, texts.values())) / sum(lines), 1),
    }
    if find_repeated:
        figures["repeated runs of statements"] = repeated(trees)
    return figures


def code_lines(text: str, tree: ast.Module) -> int:
    """Lines that hold code."""
    documentation: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            documentation.update(range(node.lineno, node.end_lineno + 1))
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") and number not in documentation
        for number, line in enumerate(text.splitlines(), 1)
    )


def percentile(values: list[int], q: int) -> int:
    return sorted(values)[min(len(values) * q // 100, len(values) - 1)]


def share(values: Iterator[bool]) -> float:
    found = list(values)
    return round(100 * sum(found) / len(found), 1)


def annotated(function: Function) -> bool:
    typed = all(x.annotation is not None for x in function.parameters)
    return typed and (function.node.returns is not None or function.node.name == "__init__")


def anonymous(annotation: ast.expr | None) -> bool:
    """Whether a parameter is a tuple of three or more, or of different things.

    ``tuple[X, ...]`` is a sequence, and two of one kind are a pair that a name explains.
    """
    if annotation is None:
        return False
    for node in ast.walk(annotation):
        if isinstance(node, ast.Subscript) and ast.unparse(node.value) == "tuple":
            members = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            if any(isinstance(m, ast.Constant) and m.value is ... for m in members):
                continue
            if len(members) > 2 or len({ast.unparse(m) for m in members}) > 1:
                return True
    return False


def untyped_compiled(function: Function) -> list[str]:
    """Decorators of numba that hide the signature from a type checker."""
    names = [ast.unparse(d).partition("(")[0] for d in function.node.decorator_list]
    return [n for n in names if n in ("njit", "numba.njit", "jit", "numba.jit", "vectorize")]


def unexplained(text: str, tree: ast.Module) -> list[str]:
    """Named numeric constants of a module that neither docstring nor comment explains.

    A docstring explains the constants above it, a comment the whole group: statements that no
    blank line separates, so that one reason serves several.
    """
    noted = {line for line, _ in comment_tokens(text)}
    found = []
    for group in groups(tree):
        if noted & {*range(group[0].lineno - 1, group[-1].end_lineno + 1)}:
            continue
        open_names: list[str] = []
        for statement in group:
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                open_names = []
            open_names += numeric_names(statement)
        found += open_names
    return found


def groups(tree: ast.Module) -> Iterator[list[ast.stmt]]:
    """Runs of module-level statements that no blank line separates."""
    group: list[ast.stmt] = []
    for statement in tree.body:
        if group and statement.lineno > group[-1].end_lineno + 1:
            yield group
            group = []
        group.append(statement)
    yield group


def numeric_names(statement: ast.stmt) -> list[str]:
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
        return []
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
    numbers = [n.value for n in ast.walk(statement.value) if isinstance(n, ast.Constant)
               and isinstance(n.value, int | float) and not isinstance(n.value, bool)]  # fmt: skip
    upper = names and all(name.strip("_").isupper() for name in names)
    return names if upper and any(number not in PLAIN for number in numbers) else []


def comment_tokens(text: str) -> Iterator[tuple[int, str]]:
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def comments(text: str) -> int:
    return len({line for line, _ in comment_tokens(text)})


def repeated(trees: dict[Path, ast.Module]) -> int:
    """Runs of equal statements, `REPEATED_LINES` lines or more, that stand in two places."""
    seen: dict[str, int] = defaultdict(int)
    for tree in trees.values():
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if not isinstance(body, list) or isinstance(node, ast.Module):
                continue
            for start in range(len(body)):
                for stop in range(start + 1, len(body) + 1):
                    run = body[start:stop]
                    if run[-1].end_lineno - run[0].lineno + 1 >= REPEATED_LINES:
                        seen["\n".join(map(ast.dump, run))] += 1
                        break
    return sum(count - 1 for count in seen.values())


if __name__ == "__main__":
    options = arguments(__doc__, package=Path)
    figures = measure(options.package or PACKAGE, find_repeated=not options.quick)
    report([{"measure": name, "mottrack": value} for name, value in figures.items()], options.json)
