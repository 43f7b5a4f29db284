"""What code a program is made of: the closure of its imports, read from the source, nothing is run.

The ledger hashes it, so that records of a run's own know the code that made them, and a test holds every stage's
declared dependencies against it. Imports inside functions count, those under `if TYPE_CHECKING` do not. What is hashed
is what the interpreter would run: comments, docstrings and layout are not part of it.

Code of a world, learner or chooser that is not ours is part of every key (`outside_code`): our own rooms carry a
VERSION for that, which a person's module does not. It counts with the modules of its package, and those that lie in one
folder with it, that it imports; installed packages of others do not count.

Left out, with what they alone import:
1. `p2l` itself, the front door: it names everything and loads nothing.
2. `p2l.schema` and `p2l.tracking`, and what all stages share to reach them: a configuration enters a result through its
   resolved values, and tracking enters none.
"""

from __future__ import annotations

import ast
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.util import find_spec
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
    return _walk(module, {"p2l": PACKAGE, **dict(packages or {})}, strict=True)


def _walk(module: str, folders: Mapping[str, Path], *, strict: bool) -> tuple[Path, ...]:
    files: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in files or name in DOORS or any(f"{name}.".startswith(f"{out}.") for out in LEFT_OUT):
            continue
        if (file := _file(name, folders)) is None:
            if not strict:  # compiled, or imported only if it is there
                continue
            raise P2LError(f"module '{name}' does not exist under {folders[name.partition('.')[0]]}")
        files[name] = file
        parts = name.split(".")
        waiting += [".".join(parts[:length]) for length in range(1, len(parts))]  # importing a module runs its packages
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        for dependency, attributes in imports(file, package):
            if dependency.partition(".")[0] in folders:
                waiting.append(dependency)
                waiting += [f"{dependency}.{each}" for each in attributes if _file(f"{dependency}.{each}", folders)]
    return tuple(sorted(file for file in set(files.values()) if _does_something(file)))


def code_digest(module: str, packages: Mapping[str, Path] | None = None) -> str:
    """Hash of the code of `closure`, for items that any change of it must run again."""
    folders = {"p2l": PACKAGE, **dict(packages or {})}
    return config_hash(sorted(_sources(closure(module, packages), folders)))


def outside_code(modules: Iterable[str]) -> str:
    """Hash of the code of modules that are not ours; empty if there are none.

    Args:
        modules: dotted names; those of p2l, and those that have no source, count for nothing.
    """
    sources: dict[str, str] = {}
    for module in modules:
        top = module.partition(".")[0]
        if top in (*DOORS, "__main__") or (place := _folder(top)) is None:
            continue
        mine = {top: place, **_neighbours(place)}
        sources |= dict(_sources(_walk(module, mine, strict=False), mine))
    return config_hash(sorted(sources.items())) if sources else ""


def _folder(top: str) -> Path | None:
    """Where a top-level package or module lies, without a suffix; None if it has no source."""
    try:
        spec = find_spec(top)
    except ValueError:  # made by hand
        return None
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    return Path(spec.origin).with_suffix("") if spec.origin and spec.origin.endswith(".py") else None


def _neighbours(place: Path) -> dict[str, Path]:
    """Packages and modules in one folder with `place`, unless it is a folder of installed packages."""
    installed = {Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib", "stdlib")}
    if place.parent.resolve() in installed:
        return {}
    found = [file.with_suffix("") for file in place.parent.iterdir() if file.suffix == ".py" or file.is_dir()]
    return {each.name: each for each in found if each.name not in ("p2l", "__init__") and each.name.isidentifier()}


def _sources(files: Iterable[Path], folders: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Dotted place and code of files, wherever their packages lie."""
    roots = {folder: name for name, folder in folders.items()}
    for file in files:
        bare = file.with_suffix("")
        root = next(root for root in roots if bare.is_relative_to(root))
        yield f"{roots[root]}/{bare.relative_to(root).as_posix()}", _code(file, file.stat().st_mtime_ns)


@cache
def _code(file: Path, changed_ns: int) -> str:
    """Hash of what a file does."""
    return config_hash(_substance(_parse(file, changed_ns)))


def _substance(node: object) -> object:
    """A syntax tree as plain values, without docstrings, and alike in all versions of Python that know its nodes."""
    if isinstance(node, list):
        return [_substance(each) for each in node if not (isinstance(each, ast.Expr) and _is_text(each.value))]
    if not isinstance(node, ast.AST):
        return [type(node).__name__, repr(node)]
    parts = {name: value for name, value in ast.iter_fields(node) if name not in ("ctx", "kind", "type_comment")}
    return [type(node).__name__, {name: _substance(value) for name, value in parts.items() if value not in (None, [])}]


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _file(name: str, folders: Mapping[str, Path]) -> Path | None:
    top, _, rest = name.partition(".")
    base = folders[top].joinpath(*rest.split(".")) if rest else folders[top]
    if (base / "__init__.py").is_file():
        return base / "__init__.py"
    file = base.with_name(f"{base.name}.py")
    return file if file.is_file() else None


@cache
def _parse(file: Path, changed_ns: int) -> ast.Module:  # noqa: ARG001 (a file that has changed is read again)
    source = file.read_bytes()
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError):  # an import that somebody's program survives without
        return ast.Module([ast.Return(ast.Constant(source))], [])


def imports(file: Path, package: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Modules that a file imports, each with the names that it takes from it.

    Args:
        file: Python source.
        package: that it is part of, to which relative imports refer.
    """
    waiting: list[ast.AST] = [_parse(file, file.stat().st_mtime_ns)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and _is_type_checking(node.test):
            waiting += node.orelse
        elif isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")
            base = parents[: len(parents) - node.level + 1] if node.level else []
            yield ".".join([*base, *([node.module] if node.module else [])]), tuple(alias.name for alias in node.names)
        else:
            waiting += ast.iter_child_nodes(node)


def _does_something(file: Path) -> bool:
    """Whether a file holds more than a docstring, as a package's own often does not."""
    body = _parse(file, file.stat().st_mtime_ns).body
    return any(not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)) for node in body)


def _is_type_checking(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"
