"""One registry: names of ours, entry points, targets; one message for what is unknown and for what is not taken."""

import signal
import time
from collections.abc import Sequence
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from p2l import registry
from p2l.errors import ConfigError
from p2l.registry import Registry


def pair(left: int, right: int = 2) -> tuple[int, int]:
    return left, right


def anything(**params: int) -> dict[str, int]:
    return params


@pytest.fixture
def pairs():
    return Registry("pair", {"ours": lambda: pair})


def test_nothing_is_imported_before_it_is_asked_for():
    def fail():
        raise AssertionError("imported")

    lazy = Registry("thing", {"heavy": fail})
    assert lazy.names() == ("heavy",)
    assert lazy.check("heavy") == "heavy"
    with pytest.raises(AssertionError, match="imported"):
        lazy.factory("heavy")


def test_a_target_needs_no_registration(pairs):
    assert pairs.factory(f"{__name__}:pair") is pair
    assert pairs.factory_for(f"{__name__}:anything", {"whatever": 1}) is anything
    pairs.register("theirs", f"{__name__}:pair")
    pairs.register("theirs", f"{__name__}:pair")
    assert pairs.names() == ("ours", "theirs")
    assert pairs.factory("theirs") is pair


def test_entry_points_of_installed_packages_are_found(pairs, monkeypatch):
    point = EntryPoint("installed", f"{__name__}:pair", "p2l.pairs")
    monkeypatch.setattr(registry, "entry_points", lambda group: [point] if group == "p2l.pairs" else [])
    assert pairs.names() == ("installed", "ours")
    assert pairs.factory("installed") is pair


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("others", "unknown pair 'others'; known: ours, or 'package.module:attribute'"),
        ("tests.nowhere:pair", "pair 'tests.nowhere:pair': there is no module 'tests.nowhere' on Python's path"),
        ("tests.test_registry:nothing", "module 'tests.test_registry' has no 'nothing'"),
    ],
)
def test_what_is_unknown_is_said_in_one_message(pairs, name, message):
    with pytest.raises(ConfigError) as caught:
        pairs.check(name)
    assert message in str(caught.value)


def test_parameters_are_checked_against_the_factory(pairs):
    assert pairs.factory_for("ours", {"right": 3}, own=1) is pair
    with pytest.raises(ConfigError, match=r"^pair 'ours': unknown parameters \['middle'\]; allowed: right$"):
        pairs.factory_for("ours", {"middle": 1}, own=1)
    with pytest.raises(ConfigError, match=r"unknown parameters \['left'\]; allowed: extra, right"):
        pairs.factory_for("ours", {"left": 1, "extra": 2}, own=1, also=["extra"])


def test_a_name_stands_for_one_thing(pairs):
    with pytest.raises(ConfigError, match="already registered; choose another name"):
        pairs.register("ours", f"{__name__}:pair")
    with pytest.raises(ConfigError, match=r"'tests\.test_registry' is no target; write 'package\.module:attribute'"):
        pairs.register("new", "tests.test_registry")


def test_what_a_factory_needs_is_asked_for(pairs):
    with pytest.raises(ConfigError, match=r"^pair 'ours': needs parameters \['left'\]; give them under params$"):
        pairs.factory_for("ours", {"right": 1})


class Empty:
    def sample(self):
        return 0


def test_what_is_made_keeps_its_contract(pairs):
    assert pairs.expect("ours", (1, 2), tuple) == (1, 2)
    with pytest.raises(ConfigError, match=r"^pair 'mine': makes a int, which is no .*Empty; it lacks sample$"):
        pairs.expect("mine", 3, Empty)


NUMBER = 3


class Sized:
    """Two kinds of parameters; `broken` is a mistake of its own."""

    def __init__(self, sizes: Sequence[float] = (1.0,), name: str = "", broken: bool = False) -> None:
        self.sizes = len(sizes)
        if broken:
            self.sizes += name  # type: ignore[operator]


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"sizes": 0.1}, r"thing 'sized': sizes must be a list of numbers, got 0\.1"),
        ({"sizes": None, "name": 3}, r"name must be a word, got 3; sizes must be a list of numbers, got None"),
    ],
)
def test_a_value_of_another_kind_is_one_message(params, message):
    """It was a traceback from inside the world."""
    things = Registry("thing", {"sized": lambda: Sized})
    factory = things.factory_for("sized", params)
    with pytest.raises(ConfigError, match=message), things.given("sized", factory, params):
        factory(**params)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"sizes": [1.0, "0.1"]}, r"sizes must be a list of numbers, got \[1\.0, '0\.1'\]"),
        ({"sizes": [True]}, r"sizes must be a list of numbers, got \[True\]"),
        ({"broken": "yes"}, "broken must be true or false, got 'yes'"),
    ],
)
def test_a_word_or_a_truth_value_is_no_number_even_where_it_could_be_taken_for_one(params, message):
    """A `"0.1"` went wrong in the middle of a simulation, and `true` counted as 1."""
    things = Registry("thing", {"sized": lambda: Sized})
    with pytest.raises(ConfigError, match=message), things.given("sized", Sized, params):
        raise AssertionError("it is refused before the call")


def test_whole_numbers_tuples_and_arrays_are_numbers():
    things = Registry("thing", {"sized": lambda: Sized})
    for params in ({"sizes": (1, 2)}, {"sizes": np.array([0.1])}, {"sizes": [1], "name": "x", "broken": False}):
        with things.given("sized", Sized, params):
            assert Sized(**params).sizes == len(params["sizes"])


def test_a_mistake_of_the_factory_keeps_its_traceback():
    things = Registry("thing", {"sized": lambda: Sized})
    params = {"sizes": np.array([0.1]), "broken": True}
    with pytest.raises(TypeError, match="unsupported operand"), things.given("sized", Sized, params):
        Sized(**params)


def test_a_target_must_be_callable_and_its_module_importable(pairs, tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match="is a int; name a class or function"):
        pairs.factory_for(f"{__name__}:NUMBER", {})
    (tmp_path / "broken_syntax.py").write_text("def made(:\n")
    (tmp_path / "broken_import.py").write_text("x = 1\nraise ValueError('on fire')\n")
    (tmp_path / "lacks_library.py").write_text("import not_installed_here\n")
    monkeypatch.syspath_prepend(tmp_path)
    for module, message in (
        ("broken_syntax", "SyntaxError: .*broken_syntax.py, line 1"),
        ("broken_import", "ValueError: on fire .*broken_import.py, line 2"),
        ("lacks_library", "ModuleNotFoundError: No module named 'not_installed_here' .*lacks_library.py, line 1"),
    ):
        with pytest.raises(ConfigError, match=f"importing '{module}' failed: {message}"):
            pairs.check(f"{module}:made")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_while_a_world_is_imported_is_not_swallowed(number):
    """robosuite looks for optional packages in bare `except` clauses, and Ctrl-C in that moment was lost."""

    def load():
        try:
            signal.raise_signal(number)
            time.sleep(0.01)
        except:  # noqa: E722
            came.append("swallowed")
        return dict

    def stop(*_):
        raise KeyboardInterrupt

    came = []
    before = signal.signal(number, stop)
    try:
        with pytest.raises(KeyboardInterrupt):
            Registry("world", {"ours": load}).factory("ours")
        assert came == []
        assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
