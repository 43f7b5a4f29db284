"""One registry for everything that is chosen by name: worlds, domains, learners, choosers, planners.

A name is looked up in this order:
1. names that p2l or a program has registered,
2. entry points of installed packages, in the group of the kind, e.g. `p2l.worlds`,
3. a target, `package.module:attribute`, of a package that is not ours; a YAML names it as `target:`.

Nothing is imported before it is asked for: entries are functions that import, so that type checkers and the computed
dependencies (`p2l.closure`) see what a name stands for. What a name is given is checked here and nowhere else, with
one message for every kind.
"""

from __future__ import annotations

import importlib
import inspect
import json
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib.metadata import entry_points
from typing import Any, Generic, TypeVar, cast, get_type_hints

from p2l.errors import ConfigError
from p2l.stops import deferred_stops

Factory = TypeVar("Factory", bound=Callable[..., Any])
Product = TypeVar("Product")
TARGET = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")
_VARIABLE = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


class Registry(Generic[Factory]):
    """Names of one kind of thing, each with a function that imports its factory.

    Args:
        kind: what it is, for messages: `world`, `learner`; its entry points are in the group `p2l.<kind>s`.
        entries: by name, what imports the factory.
    """

    def __init__(self, kind: str, entries: Mapping[str, Callable[[], Factory]]) -> None:
        self.kind = kind
        self._loaders: dict[str, Callable[[], Factory]] = dict(entries)
        self._targets: dict[str, str] = {}

    def register(self, name: str, target: str) -> None:
        """Make `target` (`package.module:attribute`) available as `name`; it is imported on first use.

        Raises:
            ConfigError: the name stands for something else, or `target` has no colon.
        """
        if not TARGET.fullmatch(target):
            raise ConfigError(f"{self.kind} '{name}': '{target}' is no target; write 'package.module:attribute'")
        if self._targets.get(name) == target:
            return
        if name in self._loaders:
            raise ConfigError(f"{self.kind} '{name}' is already registered; choose another name")
        self._loaders[name] = lambda: self._import(target)
        self._targets[name] = target

    def names(self) -> tuple[str, ...]:
        """Every name that can be given, sorted; entry points of installed packages included."""
        return tuple(sorted({*self._loaders, *(point.name for point in self._entry_points())}))

    def factory(self, name: str) -> Factory:
        """What `name`, an entry point's name or a target stands for.

        Raises:
            ConfigError: unknown, or what it names cannot be imported.
        """
        if not isinstance(name, str):
            raise ConfigError(f"{self.kind}: given {name!r}; expected a name or 'package.module:attribute'")
        if name in self._loaders:
            try:
                with deferred_stops():
                    return self._loaders[name]()
            except ImportError as error:
                if "libGL" not in str(error):
                    raise
                raise ConfigError(f"{self.kind} '{name}': {error}; {_SCREEN}") from error
        if (target := self.target(name)) is not None:
            return self._import(target)
        raise ConfigError(
            f"unknown {self.kind} '{name}'; known: {', '.join(self.names()) or 'none'}, or 'package.module:attribute'"
        )

    def target(self, name: str) -> str | None:
        """`package.module:attribute` of what is not ours; None for a name of ours, and for one that is unknown."""
        if name in self._loaders:
            return self._targets.get(name)
        if TARGET.fullmatch(name):
            return name
        return next((point.value for point in self._entry_points() if point.name == name), None)

    def check(self, name: str) -> str:
        """`name`, if it stands for something; names of our own are not imported for that.

        Raises:
            ConfigError: as `factory`.
        """
        if name not in self._loaders:
            self.factory(name)
        return name

    def factory_for(
        self, name: str, params: Mapping[str, Any] | None, *, own: int = 0, also: Iterable[str] = ()
    ) -> Factory:
        """The factory of `name`, if it takes the parameters `params`.

        Args:
            name: as for `factory`.
            params: what a person gives it.
            own: so many parameters, the first ones, are filled in by p2l.
            also: parameters that everything of this kind takes, besides those of its factory.

        Raises:
            ConfigError: unknown name, something that cannot be called, a parameter that it does not take, or one that
                it needs.
        """
        factory, given = self.factory(name), set(params or {})
        try:
            signature = list(inspect.signature(factory).parameters.values())
        except (TypeError, ValueError) as error:
            raise ConfigError(
                f"{self.kind} '{name}': is a {type(factory).__name__}; name a class or function"
            ) from error
        variable = {kind: any(each.kind is kind for each in signature) for kind in _VARIABLE}
        named = [each for each in signature if each.kind not in _VARIABLE]
        if len(named) < own and not variable[inspect.Parameter.VAR_POSITIONAL]:
            raise ConfigError(f"{self.kind} '{name}': takes {len(named)} parameters; the first {own} are p2l's")
        names = [*also, *(each.name for each in named[own:])]
        if not variable[inspect.Parameter.VAR_KEYWORD] and (unknown := sorted(given - set(names))):
            raise ConfigError(
                f"{self.kind} '{name}': unknown parameters {unknown}; allowed: {', '.join(names) or 'none'}"
            )
        needed = [each.name for each in named[own:] if each.default is each.empty]
        if missing := [each for each in needed if each not in given]:
            raise ConfigError(f"{self.kind} '{name}': needs parameters {missing}; give them under params")
        return factory

    @contextmanager
    def given(self, name: str, factory: Callable[..., Any], params: Mapping[str, Any] | None) -> Iterator[None]:
        """While `factory` is called with `params`: a value of another kind than it is annotated with is the person's.

        A word or a truth value in the place of a number is refused before the call, since it may go wrong long after;
        everything else only where the call raises a `TypeError`, since annotations of others may say too little.

        Raises:
            ConfigError: naming each such parameter.
        """
        if wrong := _of_another_kind(factory, params or {}, _is_disguised):
            raise ConfigError(f"{self.kind} '{name}': {'; '.join(wrong)}")
        try:
            yield
        except TypeError as error:
            if wrong := _of_another_kind(factory, params or {}, _is_other):
                raise ConfigError(f"{self.kind} '{name}': {'; '.join(wrong)}") from error
            raise

    def expect(self, name: str, product: Product, contract: type[Any]) -> Product:
        """`product`, which the factory of `name` has made, if it keeps its contract.

        Raises:
            ConfigError: it is something else; the message names what it lacks.
        """
        if isinstance(product, contract):
            return product
        lacking = [each for each in dir(contract) if not each.startswith("_") and not hasattr(product, each)]
        told = f"; it lacks {', '.join(lacking)}" if lacking else ""
        raise ConfigError(
            f"{self.kind} '{name}': makes a {type(product).__name__}, which is no {contract.__module__}."
            f"{contract.__name__}{told}"
        )

    def _entry_points(self) -> Iterable[Any]:
        return entry_points(group=f"p2l.{self.kind}s")

    def _import(self, target: str) -> Factory:
        module, _, attribute = target.partition(":")
        try:
            return cast(Factory, getattr(importlib.import_module(module), attribute))
        except ModuleNotFoundError as error:
            if error.name is not None and f"{module}.".startswith(f"{error.name}."):
                raise ConfigError(
                    f"{self.kind} '{target}': there is no module '{error.name}' on Python's path"
                ) from error
            raise ConfigError(f"{self.kind} '{target}': {_importing(module, error)}") from error
        except Exception as error:  # whatever a person's module raises while it is imported
            if isinstance(error, AttributeError) and module in sys.modules:
                raise ConfigError(f"{self.kind} '{target}': module '{module}' has no '{attribute}'") from error
            raise ConfigError(f"{self.kind} '{target}': {_importing(module, error)}") from error


_KINDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "a word",
    "float | None": "a number or null",
    "Sequence[float]": "a list of numbers",
    "Sequence[str]": "a list of words",
}


def _of_another_kind(
    factory: Callable[..., Any], params: Mapping[str, Any], wrongly: Callable[[Any, Any], bool]
) -> list[str]:
    """What to tell of every parameter whose value is `wrongly` given for its annotation."""
    from pydantic import PydanticSchemaGenerationError, PydanticUserError

    while isinstance(factory, partial):
        factory = factory.func
    try:
        hints = get_type_hints(factory.__init__ if isinstance(factory, type) else factory)  # type: ignore[misc]
    except (NameError, TypeError):  # of names that only a type checker knows
        return []
    wrong = []
    for name in sorted(set(params) & set(hints)):
        try:
            if wrongly(hints[name], params[name]):
                hint = hints[name]
                plain = hint.__name__ if isinstance(hint, type) else str(hint).replace("collections.abc.", "")
                wrong.append(f"{name} must be {_KINDS.get(plain, plain)}, got {params[name]!r}")
        except (PydanticSchemaGenerationError, PydanticUserError):
            continue
    return wrong


def _is_other(hint: Any, value: Any) -> bool:
    """Whether a value is not of the kind, nor can be taken for one."""
    from pydantic import TypeAdapter, ValidationError

    try:
        TypeAdapter(hint).validate_python(value.tolist() if hasattr(value, "tolist") else value)  # an array is a list
    except ValidationError:
        return True
    return False


def _is_disguised(hint: Any, value: Any) -> bool:
    """Whether a value holds a word or a truth value that can be taken for a number, but is none."""
    from pydantic import TypeAdapter, ValidationError

    if not any(isinstance(leaf, str | bool) for leaf in _leaves(value)) or _is_other(hint, value):
        return False
    try:
        TypeAdapter(hint).validate_json(json.dumps(value), strict=True)  # of lists it minds only what is in them
    except ValidationError:
        return True
    except TypeError:  # an object that JSON does not know
        return False
    return False


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for each in value:
            yield from _leaves(each)
    else:
        yield value


_SCREEN = (
    "robosuite imports OpenCV, whose usual build wants a screen: `pip install opencv-python-headless` in the place of "
    "opencv-python, or `apt install libgl1`"
)


def _importing(module: str, error: Exception) -> str:
    """What went wrong while a module was imported, and where."""
    if isinstance(error, SyntaxError):
        place = f"{error.filename}, line {error.lineno}"
    else:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{last.filename}, line {last.lineno}"
    return f"importing '{module}' failed: {type(error).__name__}: {error} ({place})"
