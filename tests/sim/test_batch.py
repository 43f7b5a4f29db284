import mujoco
import numpy as np
import pytest

from p2l.domains.insertion.physics import InsertionPhysics, build_model, start_states
from p2l.errors import ConfigError, ShapeError
from p2l.sim.batch import Engine
from p2l.sim.model import Impedance, add_impedance
from p2l.sim.trace import Trace

PHYSICS = InsertionPhysics()
WALLS = [np.array([[0.0, -0.016, 0.05, 0.005]]), np.array([[0.016, 0.0, 0.005, 0.05]])]
QUAT = np.array([1.0, 0.0, 0.0, 0.0])


def models():
    return [build_model(walls, PHYSICS) for walls in WALLS]


def play(nthread, rows, steps=12, states=None, first=0):
    """A pushing, sliding motion in contact with board and walls; returns states and sensors of every step."""
    rng = np.random.default_rng(7)
    everything = rng.normal(0.0, 0.004, (24, 2)), rng.normal(0.0, 0.02, (24, steps, 3))
    errors, motions = everything[0][rows], everything[1][rows]
    with Engine(models(), control_period_s=0.048, nthread=nthread) as engine:
        states = start_states(engine, errors, PHYSICS) if states is None else states
        path, seen = [], []
        for step in range(first, steps):
            goal = np.array([0.0, 0.0, 0.05]) + motions[:, step] * [1.0, 1.0, 0.5]
            control = engine.stiffness(len(rows), 500.0, 4.0)
            quats = np.tile(QUAT, (len(rows), 1))
            chunk = engine.step(states, goal, quats, control, np.asarray(rows) % 2)
            states = chunk.states
            path.append(states)
            seen.append(chunk.sensors)
        return np.stack(path, 1), np.concatenate(seen, 1)


@pytest.fixture(scope="module")
def reference():
    return play(1, np.arange(24))


def test_the_motion_touches_something(reference):
    states, _ = reference
    free = np.zeros(3)
    grip = states[:, -1, 1:4] + [0.0, 0.0, 0.03]
    target = states[:, -1, -7:-4]
    assert (np.linalg.norm(grip - target, axis=1) > 0.002).sum() > 5, free


def test_threads_do_not_change_a_bit(reference):
    for mine, theirs in zip(play(2, np.arange(24)), reference, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_row_alone_is_the_row_in_a_batch(reference):
    for row in (0, 5, 17):
        for mine, theirs in zip(play(2, np.array([row])), reference, strict=True):
            np.testing.assert_array_equal(mine[0], theirs[row])


def test_restoring_a_row_replays_it_to_the_bit(reference):
    rows = np.array([3, 11, 20])
    snapshot = reference[0][rows, 4].copy()
    states, sensors = play(2, rows, states=snapshot, first=5)
    np.testing.assert_array_equal(states, reference[0][rows, 5:])
    np.testing.assert_array_equal(sensors, reference[1][rows, 5 * 12 :])


def test_free_motion_is_a_spring_damper():
    """Without contact the grip obeys m·a = k·(target − x) − d·v; compared with the analytic step response."""
    physics = InsertionPhysics(damping_linear=8.0, hold_mass_kg=0.2)
    stiffness, offset = 80.0, 0.01
    with Engine([build_model(WALLS[0], physics)], control_period_s=0.004, nthread=1) as engine:
        states = start_states(engine, np.zeros((1, 2)), physics)
        states[:, 3] += 0.1
        states[:, -5] += 0.1
        goal = engine.target_pos(states) + [offset, 0.0, 0.0]
        control = engine.stiffness(1, stiffness, 4.0)
        xs = []
        for _ in range(200):
            chunk = engine.step(states, goal, QUAT[None], control, np.zeros(1, np.int64))
            states = chunk.states
            xs.append(engine.sensor(chunk, "grip_pos")[0, -1, 0])
    # Critically damped: d² = 4·k·m, so x(t) = offset·(1 − (1 + ω t)·exp(−ω t)) with ω = sqrt(k / m) = 20 rad/s.
    t = np.arange(1, 201) * 0.004
    expected = offset * (1.0 - (1.0 + 20.0 * t) * np.exp(-20.0 * t))
    np.testing.assert_allclose(xs, expected, atol=3e-4)


def test_the_trace_joins_chunks_and_names_its_columns():
    with Engine(models(), control_period_s=0.048, nthread=1) as engine:
        states = start_states(engine, np.zeros((2, 2)), PHYSICS)
        control = engine.stiffness(2, 500.0, 4.0)
        goal = engine.target_pos(states)
        chunks = []
        for _ in range(3):
            chunks.append(engine.step(states, goal, np.tile(QUAT, (2, 1)), control, np.arange(2)))
        trace = Trace.join(states, chunks, engine.sensor_columns, engine.timestep_s)
    assert trace.states.shape == (2, 4, engine.state_size)
    assert trace.sensor("tip_pos").shape == (2, 36, 3)
    np.testing.assert_allclose(trace.sensor("grip_pos") - trace.sensor("tip_pos"), [[[0, 0, 0.06]] * 36] * 2, atol=1e-3)


def test_unlike_inputs_are_refused():
    with Engine(models(), control_period_s=0.048, nthread=1) as engine:
        states = start_states(engine, np.zeros((2, 2)), PHYSICS)
        goal, quat = np.zeros((2, 3)), np.tile(QUAT, (2, 1))
        control = engine.stiffness(2, 1.0, 1.0)
        with pytest.raises(ShapeError, match="target_pos has shape"):
            engine.step(states, goal[:1], quat, control, np.zeros(2, np.int64))
        with pytest.raises(ShapeError, match="control holds NaN"):
            engine.step(states, goal, quat, control * np.nan, np.zeros(2, np.int64))
        chunk = engine.step(states, goal, quat, control, np.zeros(2, np.int64))
        with pytest.raises(ConfigError, match="no sensor 'force'; sensors: grip_pos, tip_pos"):
            engine.sensor(chunk, "force")


def test_impossible_engines_are_refused():
    with pytest.raises(ConfigError, match="no multiple"):
        Engine(models(), control_period_s=0.005, nthread=1)
    with pytest.raises(ConfigError, match="at least one model"):
        Engine([], control_period_s=0.05, nthread=1)
    bare = mujoco.MjSpec()
    bare.worldbody.add_body().add_freejoint()
    bare.bodies[1].add_geom(size=[0.1, 0.1, 0.1])
    with pytest.raises(ConfigError, match="no impedance target"):
        Engine([bare.compile()], control_period_s=0.05, nthread=1)
    with pytest.raises(ConfigError, match="no site 'hand'"):
        add_impedance(bare, Impedance("hand", 1.0, 1.0))


def test_no_rows_stay_no_rows():
    """MuJoCo's own rollout ends the process on an empty batch."""
    with Engine(models(), control_period_s=0.048, nthread=2) as engine:
        states = engine.states_from(np.zeros((0, engine.nq)), np.zeros((0, 3)), np.zeros((0, 4)))
        index, control = np.zeros(0, dtype=np.int64), engine.stiffness(0, 500.0, 4.0)
        assert engine.sense(states, control, index).shape[0] == 0
        chunk = engine.step(states, np.zeros((0, 3)), np.zeros((0, 4)), control, index)
    assert chunk.states.shape == states.shape
    assert not len(chunk.diverged)


def test_the_fingerprint_is_of_the_physics():
    heavy = models()
    heavy[1].body_mass[np.argmax(heavy[1].body_mass)] *= 2.0
    hashes = []
    for each in (models(), models(), heavy):
        with Engine(each, control_period_s=0.048, nthread=1) as engine:
            hashes.append(engine.fingerprint())
    assert hashes[0] == hashes[1] != hashes[2]
