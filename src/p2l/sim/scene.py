"""From robosuite's arenas, arms and objects to a model with impedance inside, and a second one with the visuals.

robosuite composes the scene; its torque motors, its mocap bodies and every visual geom leave, and what the batched
engine needs enters: gravity compensation of the robot, the impedance of `sim.model`, named sensors, and furniture
whose pose is part of a row's state (a mocap body), so that each row has its own door pose or shelf height without a
second model.

Deviations from robosuite's physics, each because it costs time on every step and decides nothing here:
1. No air unless `Physics` says so (robosuite: density 1.2 kg/m³); its forces and their derivatives take a third of a
   step. It does decide: MuJoCo's drag takes a body for a box of its inertia, robosuite's finger tips (10 g) for boxes
   of 2.5 m, and a hand that turns is braked by up to 14 N·m, of the 12 that its last motor has.
2. The arm's links touch the world but not one another or the robot's mount; nominal motions keep them apart, and
   testing neighbouring meshes takes another third.
"""

from __future__ import annotations

import copy
import dataclasses
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.sim.model import Impedance, add_impedance

logging.disable(logging.WARNING)  # robosuite tells of optional packages when it is imported
from robosuite.models.bases import robot_base_factory  # noqa: E402
from robosuite.models.grippers import gripper_factory  # noqa: E402
from robosuite.models.robots import create_robot  # noqa: E402
from robosuite.models.tasks import ManipulationTask  # noqa: E402

logging.disable(logging.NOTSET)

ARMS = ("Panda", "UR5e", "IIWA", "Kinova3", "Sawyer", "XArm7")
GRIP_SITE = "gripper0_right_grip_site"
WRIST_FORCE = "gripper0_right_force_ee"
FINGERS = ("gripper0_right_finger_joint1", "gripper0_right_finger_joint2")
FINGER_ACTUATORS = ("gripper0_right_gripper_finger_joint1", "gripper0_right_gripper_finger_joint2")
FINGER_OPEN_M = 0.04
AIR_VISCOSITY = 2e-5  # Pa·s, robosuite's
HAND = ("gripper0_right_hand_collision",)


@dataclass(frozen=True)
class Physics:
    """Numbers of the simulation and of the impedance.

    Attributes:
        timestep_s: physics time step.
        stiffness_linear, stiffness_angular: N/m and N·m/rad of the impedance.
        damping_linear, damping_angular: N·s/m and N·m·s/rad.
        joint_damping: N·m·s/rad added to every joint of the arm; it settles the redundant joint.
        impratio: of contacts, how much stiffer friction is than the normal force. MuJoCo's friction gives way slowly,
            the more the smaller this is; robosuite's 20 lets a held box turn by 0.016 rad/s in the hand.
        torque_limits: whether the arm's joints have the limits of robosuite's motors; without them a hand can push as
            hard as its impedance wants.
        friction_scale: factor on the sliding friction of every geom.
        axis_scale: [6] factors on the impedance's stiffness and damping along and about each axis of the hand (z is
            where the fingers point). A controller that shapes both by the hand's inertia, as OSC does, has such.
        air_density: kg/m³; robosuite has 1.2.
        armature_scale: factor on the inertia of the arm's motors, which is most of what the hand is moved with. Another
            arm, or another posture, is as if it were heavier: about one axis a UR5e at the shelf 15 times.
    """

    timestep_s: float = 0.002
    stiffness_linear: float = 600.0
    stiffness_angular: float = 40.0
    damping_linear: float = 160.0
    damping_angular: float = 8.0
    joint_damping: float = 1.0
    impratio: float = 20.0
    torque_limits: bool = False
    friction_scale: float = 1.0
    axis_scale: tuple[float, ...] = (1.0,) * 6
    air_density: float = 0.0
    armature_scale: float = 1.0


@dataclass(frozen=True)
class Scene:
    """A composed scene.

    Attributes:
        model: for the engine; no visual geom.
        visual_model: the same joints and bodies with visual geoms, for videos.
        arm_joints: names of the arm's joints, in order.
        home: [J] robosuite's own start posture of the arm, rad.
        physics: its numbers.
        fingers: control of each finger's actuator when open and when closed.
    """

    model: mujoco.MjModel
    visual_model: mujoco.MjModel
    arm_joints: tuple[str, ...]
    home: Array
    physics: Physics
    fingers: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Parts:
    """What a world puts in front of the robot.

    Attributes:
        arena: a robosuite arena.
        objects: robosuite objects, free or fixed.
        base_pos_world: [3] of the robot's base, m (robosuite adds the height of its mount).
        furniture: bodies whose pose is state; each must be a child of the world without a joint.
        pose_sensors: bodies that get the sensors `<name>_pos` and `<name>_quat`, by `<name>`.
        edit: last changes of the spec, e.g. another handle; called before the model is compiled.
    """

    arena: object
    objects: Sequence[object]
    base_pos_world: Sequence[float]
    furniture: tuple[str, ...] = ()
    pose_sensors: dict[str, str] = field(default_factory=dict)
    edit: Callable[[mujoco.MjSpec], None] | None = None


def build(arm: str, parts: Parts, physics: Physics) -> Scene:
    """Compose, prepare and compile a scene with one arm and the Panda's parallel-jaw gripper.

    Raises:
        ConfigError: unknown arm, or a piece of furniture that the scene does not have.
    """
    if arm not in ARMS:
        raise ConfigError(f"unknown arm '{arm}'; known arms: {', '.join(ARMS)}")
    robot = create_robot(arm, idn=0)
    robot.add_gripper(gripper_factory("PandaGripper", idn="0_right"), robot.eef_name["right"])
    robot.add_base(robot_base_factory(robot.default_base, idn=0))
    robot.set_base_xpos(np.asarray(parts.base_pos_world, dtype=np.float64))
    task = ManipulationTask(mujoco_arena=parts.arena, mujoco_robots=[robot], mujoco_objects=list(parts.objects))
    xml = task.get_xml()
    joints = tuple(robot.joints)
    home = np.asarray(robot.init_qpos, dtype=np.float64)
    fingers = dict(zip(FINGER_ACTUATORS, ((FINGER_OPEN_M, 0.0), (-FINGER_OPEN_M, 0.0)), strict=True))

    def spec() -> mujoco.MjSpec:
        return _robot_spec(xml, parts, physics, joints)

    model, visual_model = finish(spec, GRIP_SITE, parts.pose_sensors, parts.furniture, physics)
    return Scene(model, visual_model, joints, home, physics, fingers)


def finish(
    spec: Callable[[], mujoco.MjSpec],
    grip_site: str,
    pose_sensors: Mapping[str, str],
    furniture: Sequence[str],
    physics: Physics,
) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Put impedance, sensors and furniture into a scene and compile it, without visuals and with them.

    Args:
        spec: makes the scene; called twice, since the preparation changes a spec.
        grip_site: the site that follows the impedance target; it gets the sensors `grip_pos` and `grip_quat`.
        pose_sensors: body or site of each further pair of sensors, by the name before `_pos` and `_quat`.
        furniture: bodies whose pose is part of the state.
        physics: of the simulation.

    Raises:
        ConfigError: a body or site that the scene does not have.
    """
    return (
        _compile(spec(), grip_site, pose_sensors, furniture, physics, visuals=False),
        _compile(spec(), grip_site, pose_sensors, furniture, physics, visuals=True),
    )


def variant(scene: Scene, edit: Callable[[mujoco.MjModel], None]) -> Scene:
    """The same scene with numbers of its models changed in place (sizes, masses, friction), without compiling again."""
    model, visual_model = model_variant(scene.model, edit), model_variant(scene.visual_model, edit)
    return dataclasses.replace(scene, model=model, visual_model=visual_model)


def model_variant(model: mujoco.MjModel, edit: Callable[[mujoco.MjModel], None]) -> mujoco.MjModel:
    """A copy of a compiled model with numbers changed in place; what MuJoCo derives from masses follows."""
    model = copy.copy(model)
    edit(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _robot_spec(xml: str, parts: Parts, physics: Physics, joints: tuple[str, ...]) -> mujoco.MjSpec:
    """The scene of robosuite without its motors and mocap bodies, the robot weightless."""
    spec = mujoco.MjSpec.from_string(xml)
    for body in [body for body in spec.bodies if body.mocap]:
        spec.delete(body)
    motors = [actuator for actuator in spec.actuators if actuator.name not in FINGER_ACTUATORS]
    torques_nm = {motor.target: tuple(motor.ctrlrange) for motor in motors}
    for motor in motors:
        spec.delete(motor)
    for sensor in [sensor for sensor in spec.sensors if sensor.name != WRIST_FORCE]:
        spec.delete(sensor)
    for body in spec.bodies:
        if body.name.startswith(("robot0_", "gripper0_")):
            body.gravcomp = 1.0
    for joint in spec.joints:
        if joint.name in joints:
            joint.damping = [physics.joint_damping, 0.0, 0.0]
            joint.armature *= physics.armature_scale
            if physics.torque_limits:
                joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, torques_nm[joint.name]
    for geom in spec.geoms:
        if geom.parent.name.startswith(("robot0_", "fixed_mount0_")) or geom.name in HAND:
            geom.contype = 0
    spec.option.impratio = physics.impratio
    spec.option.density, spec.option.viscosity = physics.air_density, AIR_VISCOSITY if physics.air_density else 0.0
    if parts.edit is not None:
        parts.edit(spec)
    if physics.friction_scale != 1.0:
        for geom in spec.geoms:
            sliding, *others = geom.friction
            geom.friction = [sliding * physics.friction_scale, *others]
    return spec


def _compile(
    spec: mujoco.MjSpec,
    grip_site: str,
    pose_sensors: Mapping[str, str],
    furniture: Sequence[str],
    physics: Physics,
    *,
    visuals: bool,
) -> mujoco.MjModel:
    add_impedance(spec, Impedance(grip_site, physics.damping_linear, physics.damping_angular, physics.axis_scale))
    for name in furniture:
        _body(spec, name).mocap = True
    for name, on in {"grip": grip_site, **pose_sensors}.items():
        site = spec.site(on) is not None
        kind = mujoco.mjtObj.mjOBJ_SITE if site else mujoco.mjtObj.mjOBJ_XBODY  # BODY would be the frame of its inertia
        on_name = on if site else _body(spec, on).name
        spec.add_sensor(name=f"{name}_pos", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=kind, objname=on_name)
        spec.add_sensor(name=f"{name}_quat", type=mujoco.mjtSensor.mjSENS_FRAMEQUAT, objtype=kind, objname=on_name)
    if not visuals:
        for geom in [geom for geom in spec.geoms if geom.contype == 0 and geom.conaffinity == 0]:
            spec.delete(geom)
        _drop_visual_assets(spec)
    spec.option.timestep = physics.timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return spec.compile()


def _drop_visual_assets(spec: mujoco.MjSpec) -> None:
    """Delete the meshes, materials and textures that nothing collides with: 60 MB become 3, and copies are cheap."""
    collision_meshes = {geom.meshname for geom in spec.geoms}
    for geom in spec.geoms:
        geom.material = ""
    for part in [*(mesh for mesh in spec.meshes if mesh.name not in collision_meshes), *spec.materials, *spec.textures]:
        spec.delete(part)


def _body(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    body = spec.body(name)
    if body is None:
        raise ConfigError(f"scene: no body '{name}'; bodies: {', '.join(body.name for body in spec.worldbody.bodies)}")
    return body
