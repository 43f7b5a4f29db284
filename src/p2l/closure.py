"""What code a program is made of: the closure of its imports, read from the source, nothing is run.

The ledger hashes it, so that records of a run's own know the code that made them, and a test holds every stage's
declared dependencies against it. Imports inside functions count, those under `if TYPE_CHECKING` do not.

Left out, with what they alone import:
1. `p2l` itself, the front door: it names everything and loads nothing.
2. `p2l.schema` and `p2l.tracking`, and what all stages share to reach them: a configuration enters a result through its
   resolved values, and tracking enters none.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from p2l.artifacts import config_hash
from p2l.errors import P2LError

PACKAGE = Path(__file__).parent
LEFT_OUT = (
    "p2l.schema",
    "p2l.tracking",
    "stages._stage",
    "stages._child",
    "stages._bridge",
    "stages._progress",
    "stages._sweep",
)
DOORS = ("p2l", "stages")  # packages whose own file is left out, not what lies in them


def closure(module: str, packages: Mapping[str, Path] | None = None) -> tuple[Path, ...]:
    """Files of a module and of all that it imports, sorted.

    Args:
        module: dotted name, e.g. `stages.plan`.
        packages: folders by top-level name beside `p2l`; imports of others are not followed.

    Raises:
        P2LError: a module that is imported does not exist.
    """
    folders = {"p2l": PACKAGE, **dict(packages or {})}
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in files or name in DOORS or any(f"{name}.".startswith(f"{out}.") for out in LEFT_OUT):
            continue
        if (file := _file(name, folders)) is None:
            raise P2LError(f"module '{name}' does not exist under {folders[name.partition('.')[0]]}")
        files[name] = file
        parts = name.split(".")
        waiting += [".".join(parts[:length]) for length in range(1, len(parts))]  # importing a module runs its packages
        for dependency, attributes in imports(file):
            if dependency.partition(".")[0] in folders:
                waiting.append(dependency)
                waiting += [f"{dependency}.{each}" for each in attributes if _file(f"{dependency}.{each}", folders)]
    return tuple(sorted(file for file in set(files.values()) if _does_something(file)))


def code_digest(module: str, packages: Mapping[str, Path] | None = None) -> str:
    """Hash of the source of `closure`, for items that any change of it must run again."""
    folders = {"p2l": PACKAGE, **dict(packages or {})}
    roots = {folder.resolve(): name for name, folder in folders.items()}
    sources = []
    for file in closure(module, packages):
        root = next(root for root in roots if file.resolve().is_relative_to(root))
        place = f"{roots[root]}/{file.resolve().relative_to(root).as_posix()}"
        sources.append([place, file.read_text(encoding="utf-8")])
    return config_hash(sorted(sources))


def _file(name: str, folders: Mapping[str, Path]) -> Path | None:
    top, _, rest = name.partition(".")
    base = folders[top].joinpath(*rest.split(".")) if rest else folders[top]
    if (base / "__init__.py").is_file():
        return base / "__init__.py"
    file = base.with_name(f"{base.name}.py")
    return file if file.is_file() else None


@cache
def _parse(file: Path, changed_ns: int) -> ast.Module:  # noqa: ARG001 (a file that has changed is read again)
    return ast.parse(file.read_text(encoding="utf-8"))


def imports(file: Path) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Modules that a file imports, each with the names that it takes from it."""
    waiting: list[ast.AST] = [_parse(file, file.stat().st_mtime_ns)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and _is_type_checking(node.test):
            waiting += node.orelse
        elif isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level or node.module is None:
                raise P2LError(f"{file}, line {node.lineno}: a relative import; write the whole name")
            yield node.module, tuple(alias.name for alias in node.names)
        else:
            waiting += ast.iter_child_nodes(node)


def _does_something(file: Path) -> bool:
    """Whether a file holds more than a docstring, as a package's own often does not."""
    body = _parse(file, file.stat().st_mtime_ns).body
    return any(not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)) for node in body)


def _is_type_checking(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"
