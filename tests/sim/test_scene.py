"""Scenes composed by robosuite: what enters, what leaves, and that furniture stands where its row says."""

import mujoco
import numpy as np
import pytest

from p2l.errors import ConfigError
from p2l.sim.batch import Engine
from p2l.sim.posture import reach
from p2l.sim.scene import GRIP_SITE, WRIST_FORCE, Parts, Physics, build, variant

PHYSICS = Physics(timestep_s=0.005)
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def parts(**changes):
    from robosuite.models.arenas import TableArena
    from robosuite.models.objects import BoxObject

    arena = TableArena(table_full_size=(0.8, 0.8, 0.05), table_offset=(0.0, 0.0, 0.8))
    arena.set_origin([0, 0, 0])
    screen = BoxObject(name="screen", size=[0.02, 0.1, 0.1], joints=None)
    cube = BoxObject(name="cube", size=[0.02, 0.02, 0.02], density=500)
    given = {"furniture": ("screen_main",), "pose_sensors": {"screen": "screen_main", "cube": "cube_main"}} | changes
    return Parts(arena, (screen, cube), (-0.56, 0.0, 0.0), **given)


@pytest.fixture(scope="module")
def scene():
    return build("Panda", parts(), PHYSICS)


def start(scene, engine, screens):
    """The arm at home, the cube on the table, a screen at each given place."""
    qpos = np.tile(scene.model.qpos0, (len(screens), 1))
    qpos[:, :7] = scene.home
    cube = int(scene.model.joint("cube_joint0").qposadr[0])
    qpos[:, cube : cube + 3] = [0.0, 0.25, 0.8201]
    poses = np.concatenate([screens, np.tile([1.0, 0.0, 0.0, 0.0], (len(screens), 1))], axis=1)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = qpos[0]
    mujoco.mj_forward(scene.model, data)
    grip = data.site(GRIP_SITE)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, grip.xmat)
    return engine.states_from(qpos, grip.xpos, quat, {"screen_main": poses})


def test_what_enters_and_what_leaves(scene):
    model = scene.model
    names = [model.actuator(i).name for i in range(model.nu)]
    assert sum(name.startswith("impedance_") for name in names) == 6
    assert not any("torq" in name for name in names)
    assert len(names) == 8  # and two fingers
    assert not ((model.geom_contype == 0) & (model.geom_conaffinity == 0)).any()
    assert scene.visual_model.ngeom > model.ngeom
    assert (scene.visual_model.nq, scene.visual_model.nv, scene.visual_model.nmocap) == (
        model.nq,
        model.nv,
        model.nmocap,
    )
    assert model.opt.timestep == PHYSICS.timestep_s


def test_furniture_stands_where_its_row_says_without_another_model(scene):
    screens = np.array([[0.3, -0.3, 0.9], [0.2, 0.1, 1.0], [-0.1, 0.3, 0.95]])
    with Engine([scene.model], control_period_s=0.05, nthread=2) as engine:
        states = start(scene, engine, screens)
        index = np.zeros(3, dtype=np.int64)
        control = engine.stiffness(3, PHYSICS.stiffness_linear, PHYSICS.stiffness_angular)
        where = engine.sensor_columns["screen_pos"]
        np.testing.assert_allclose(engine.sense(states, control, index)[:, where], screens, atol=1e-12)
        place = engine.physics_size
        chunk = engine.step(states, states[:, place : place + 3], states[:, place + 3 : place + 7], control, index)
        np.testing.assert_allclose(chunk.sensors[:, -1, where], screens, atol=1e-12)
        np.testing.assert_array_equal(chunk.states[:, place + 7 :], states[:, place + 7 :])


def test_the_arm_follows_its_target_in_free_space(scene):
    with Engine([scene.model], control_period_s=0.05, nthread=1) as engine:
        states = start(scene, engine, np.array([[0.3, -0.3, 0.9]]))
        place = engine.physics_size
        goal = states[:, place : place + 3] + [0.05, 0.08, -0.04]
        control = engine.stiffness(1, PHYSICS.stiffness_linear, PHYSICS.stiffness_angular)
        for _ in range(40):
            chunk = engine.step(states, goal, states[:, place + 3 : place + 7], control, np.zeros(1, dtype=np.int64))
            states = chunk.states
        assert np.linalg.norm(engine.sensor(chunk, "grip_pos")[0, -1] - goal[0]) < 0.005
        assert np.linalg.norm(engine.sensor(chunk, WRIST_FORCE)[0, -1]) < 15.0  # the hand's weight, no contact


def test_a_variant_changes_only_itself(scene):
    cube = scene.model.body("cube_main").id

    def heavy(model):
        model.body_mass[model.body("cube_main").id] = 1.5

    changed = variant(scene, heavy)
    assert (
        changed.model.body_mass[cube]
        == changed.visual_model.body_mass[changed.visual_model.body("cube_main").id]
        == 1.5
    )
    assert scene.model.body_mass[cube] == pytest.approx(500 * 0.04**3)
    Engine([scene.model, changed.model], control_period_s=0.05, nthread=1).close()


@pytest.mark.parametrize("arm", ["Panda", "UR5e"])
def test_reach_puts_the_grip_site_there_or_says_none(arm, scene):
    scene = scene if arm == "Panda" else build(arm, parts(), PHYSICS)
    wanted = np.array([0.0, 0.1, 1.0])
    posture = reach(scene, wanted, DOWN)
    data = mujoco.MjData(scene.model)
    for name, angle in zip(scene.arm_joints, posture, strict=True):
        data.joint(name).qpos = angle
        assert scene.model.joint(name).range[0] <= angle <= scene.model.joint(name).range[1]
    mujoco.mj_forward(scene.model, data)
    np.testing.assert_allclose(data.site(GRIP_SITE).xpos, wanted, atol=2e-3)
    assert reach(scene, np.array([3.0, 0.0, 1.0]), DOWN, restarts=2) is None


def test_bad_scenes_are_refused():
    with pytest.raises(ConfigError, match=r"unknown arm 'R2D2'; known arms: Panda, UR5e"):
        build("R2D2", parts(), PHYSICS)
    with pytest.raises(ConfigError, match="no body 'sofa'"):
        build("Panda", parts(furniture=("sofa",)), PHYSICS)


def test_unknown_furniture_is_refused(scene):
    with Engine([scene.model], control_period_s=0.05, nthread=1) as engine:  # noqa: SIM117
        with pytest.raises(ConfigError, match=r"no furniture \['sofa'\]; the model has: screen_main"):
            engine.states_from(scene.model.qpos0, np.zeros(3), DOWN, {"sofa": np.zeros((1, 7))})
