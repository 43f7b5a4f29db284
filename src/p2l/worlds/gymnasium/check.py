"""What an environment must keep before it may be a world; looked at once, in the first of its processes.

1. The start of an episode is drawn by its seed, in every environment of `make_env` alike.
2. A state that is put back, into this or another environment of `make_env`, goes on as it did, to the bit.
3. Every controller ends by itself, at least sometimes, within its bound.
"""

from __future__ import annotations

import importlib.metadata
from dataclasses import dataclass
from typing import Any

import numpy as np

from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError
from p2l.records import Array
from p2l.skills.runner import Reason
from p2l.worlds.gymnasium.jobs import Moment, OptionJob
from p2l.worlds.gymnasium.layout import Layout
from p2l.worlds.gymnasium.simulation import Simulation
from p2l.worlds.gymnasium.snapshot import differing_fields, unpack

_STEPS = 10  # before the state is taken, and after
_EPISODES = 10  # of the nominal chain, at most
_SPARE = 1.25  # capacity of a row over the largest state seen: lists inside may grow
_UNIT = 1024


@dataclass(frozen=True)
class Facts:
    """What a world needs to know of its environment.

    Attributes:
        layout: of observations and actions.
        state_bytes: that a row has for a state.
        control_period_s: of a control step; 0 if the environment does not tell.
        identity: its class and the versions of what it runs on.
        remarks: what is allowed, and hardly meant.
    """

    layout: Layout
    state_bytes: int
    control_period_s: float
    identity: tuple[str, ...]
    remarks: tuple[str, ...]


def facts_of(simulation: Simulation) -> Facts:
    """Check an environment; leaves it somewhere in an episode.

    Raises:
        ConfigError: it does not keep one of the rules above; the message says which part of the state differs.
    """
    other = Simulation(simulation.definition)
    _check_seeds(simulation, other)
    size, unlike = _check_restoring(simulation, other)
    largest, failing = _check_endings(simulation)
    state_bytes = -(-int(_SPARE * max(size, largest) + 4 * _UNIT) // _UNIT) * _UNIT
    period_s, identity = _control_period_s(simulation.env), _identity(simulation.env)
    return Facts(simulation.layout, state_bytes, period_s, identity, (*_remarks(simulation), *unlike, *failing))


def _check_seeds(simulation: Simulation, other: Simulation) -> None:
    simulation.reset(1)
    other.reset(1)
    one, two, parts = simulation.observation, other.observation, simulation.layout.parts
    if keys := [key for key, part in parts.items() if not np.array_equal(one[part.where], two[part.where])]:
        raise ConfigError(
            "env.reset(seed=1) gives one start in one environment of make_env and another in the next (observation "
            f"'{keys[0]}'): it must be drawn by that seed; if the environment is seeded otherwise, wrap its reset"
        )


def _remarks(simulation: Simulation) -> tuple[str, ...]:
    starts = []
    for seed in (1, 2, 3):
        simulation.reset(seed)
        starts.append(simulation.observation.copy())
    if all(np.array_equal(start, starts[0]) for start in starts):
        return ("`env.reset(seed=…)` gives the same observation for every seed: is its start drawn by that seed?",)
    return ()


def _check_restoring(simulation: Simulation, other: Simulation) -> tuple[int, tuple[str, ...]]:
    """Size of a state, in bytes, and a remark on fields that come back otherwise than they were put."""
    layout, space = simulation.layout, simulation.env.action_space
    space.seed(0)
    actions = [np.reshape(np.asarray(space.sample(), dtype=np.float64), -1) for _ in range(2 * _STEPS)]
    simulation.reset(1)
    for action in actions[:_STEPS]:
        _go(simulation, action)
    start = simulation.take()
    way = _play(simulation, actions[_STEPS:])
    other.reset(2)
    for action in actions[:3]:
        _go(other, action)
    for again, where in ((simulation, ""), (simulation, ""), (other, " into another environment of make_env")):
        again.put(start)
        unlike = differing_fields(unpack(start.state), dict(again.fields()))
        for step, (was, now) in enumerate(zip(way, _play(again, actions[_STEPS:]), strict=True), start=1):
            if not np.array_equal(was.sensed, now.sensed):
                raise ConfigError(_difference(layout, where, step, was, now, unlike))
        if unlike and simulation.definition.get_state:
            raise ConfigError(f"set_state(env, state) does not put back what get_state(env) gave: {_some(unlike)}")
    remark = f"fields of the state come back otherwise than they were put, without effect so far: {_some(unlike)}"
    return max(len(moment.state) for moment in (start, *way)), (remark,) if unlike else ()


def _go(simulation: Simulation, action: Array) -> None:
    error = np.zeros(len(simulation.noise.sigma))
    done = simulation.run(OptionJob(0, 0, np.zeros(0), error, NO_FAILURE, False, False, 1, action))
    if done.told:
        raise ConfigError(done.told)


def _play(simulation: Simulation, actions: list[Array]) -> list[Moment]:
    moments = []
    for action in actions:
        _go(simulation, action)
        moments.append(simulation.take())
    return moments


def _difference(layout: Layout, where: str, step: int, was: Moment, now: Moment, unlike: list[str]) -> str:
    keys = [key for key, part in layout.parts.items() if (was.sensed[part.where] != now.sensed[part.where]).any()]
    what = f"observation '{keys[0]}'" if keys else "whether the task is done"
    fields = differing_fields(unpack(was.state), unpack(now.state))
    after = f"; right after it was put back, these fields were unlike: {_some(unlike)}" if unlike else ""
    return (
        f"a state that was put back{where} does not go on as it did: after {step} control "
        f"step{'s' if step > 1 else ''} {what} differs, and of the state {_some(fields) or 'no kept field'}{after}. "
        "Keep what is missing by `get_state(env)` and `set_state(env, state)`, or take what is random out of `step`"
    )


def _some(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _check_endings(simulation: Simulation) -> tuple[int, tuple[str, ...]]:
    """Run the nominal chain until each skill has ended by itself; the largest state on the way, and remarks."""
    definition, largest = simulation.definition, 0
    starts, late, ended = np.zeros((3, len(definition.controllers)), dtype=np.int64)
    error = np.zeros(len(simulation.noise.sigma))
    for episode in range(_EPISODES):
        simulation.reset(10 + episode)
        for place, controller in enumerate(definition.controllers):
            option = len(definition.primitives) + place
            memory = np.zeros(controller.memory_size)
            outcome = simulation.run(OptionJob(option, 0, memory, error, NO_FAILURE, False, True, 0))
            largest = max(largest, len(simulation.take().state))
            starts[place] += 1
            late[place] += outcome.reason == Reason.TIMEOUT
            ended[place] += outcome.reason == Reason.TERMINATION
            if outcome.told:
                raise ConfigError(f"controller '{controller.name}': {outcome.told}")
            if outcome.reason == Reason.FAILURE:
                break
        if ended.all():
            break
    for controller, begun, slow, well in zip(definition.controllers, starts, late, ended, strict=True):
        if slow and not well:
            raise ConfigError(
                f"controller '{controller.name}' never ends by itself: of {begun} runs with exact observations {slow} "
                f"met its bound of {controller.max_steps} control steps, a detector ended the others; let `act` return "
                "done=True, or raise max_steps"
            )
    failing = [one.name for one, n, k in zip(definition.controllers, starts, ended, strict=True) if n and not k]
    told = f"'{', '.join(failing)}' was flagged in each of {_EPISODES} runs with exact observations: is it right?"
    return largest, (told,) if failing else ()


def _control_period_s(env: Any) -> float:
    inner = env.unwrapped
    for name, to_seconds in (("dt", float), ("control_timestep", float), ("control_freq", lambda hz: 1.0 / float(hz))):
        try:
            return float(to_seconds(getattr(inner, name)))
        except (AttributeError, TypeError, ValueError, ZeroDivisionError):
            continue
    return 0.0


def _identity(env: Any) -> tuple[str, ...]:
    kind = type(env.unwrapped)
    spec = getattr(env, "spec", None)
    tops = sorted({kind.__module__.partition(".")[0], "gymnasium", "mujoco", "numpy"})
    return (f"{kind.__module__}.{kind.__qualname__}", str(getattr(spec, "id", "")), *(_version(top) for top in tops))


def _version(top: str) -> str:
    names = importlib.metadata.packages_distributions().get(top, [])
    return f"{names[0]} {importlib.metadata.version(names[0])}" if names else top
