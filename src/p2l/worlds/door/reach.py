"""Where the arm starts in front of the door, and which doors it can open from there.

Axis letters: N places of the door, J joints of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p2l import poses
from p2l.records import Array
from p2l.sim.posture import reach
from p2l.sim.scene import Scene
from p2l.worlds.door.handles import axis_of, grasp_pose, hinge_of

START_AWAY_M = 0.2  # from the grasp, which is 4 cm beyond the lever
POSTURE_NM = 5.0  # N·m/rad that draw each joint to the start posture
BRANCH_RAD = 2.0  # a joint that turns farther between two poses of a motion has left its branch


def start_posture(scene: Scene, pos: Array, quat: Array, open_rad: float) -> tuple[float, Array] | list[int]:
    """Which way round the fingers grasp (1 or −1) and the start posture [J], rad; else the places out of reach.

    The hand starts in front of the first handle. From there the arm must reach every handle, turn it by a right
    angle and open the door, without leaving its branch of postures.

    Args:
        scene: with the arm.
        pos: [N, 3] of the handles of shut doors, world frame, m.
        quat: [N, 4] of these.
        open_rad: how far the doors are opened.
    """
    missing = list(range(len(pos)))
    for sign in (1.0, -1.0):
        held, grasp, into = grasp_pose(pos, quat, sign)
        start = reach(scene, (held - START_AWAY_M * into)[0], grasp[0])
        if start is None:
            continue
        ways = _ways(pos, quat, held, grasp, into, open_rad)
        left = [row for row in range(len(pos)) if not _follows(scene, start, [(p[row], q[row]) for p, q in ways])]
        if not left:
            return sign, start
        missing = min(missing, left, key=len)
    return missing


def hold_posture(scenes: Sequence[Scene], start: Array) -> None:
    """Weak springs draw the arm's joints to `start` [J], rad.

    The models change in place: the start is known only once an engine has told where the handles are.
    """
    for scene in scenes:
        for name, rest in zip(scene.arm_joints, start, strict=True):
            joint = scene.model.joint(name)
            scene.model.jnt_stiffness[joint.id] = POSTURE_NM
            scene.model.qpos_spring[joint.qposadr[0]] = rest


def _ways(
    pos: Array, quat: Array, held: Array, grasp: Array, into: Array, open_rad: float
) -> tuple[tuple[Array, Array], ...]:
    """Poses of the hand that grasps, has turned the handle, and has opened the door."""
    down = poses.about(into, np.full(len(pos), np.pi / 2))
    swing = poses.about([0.0, 0.0, 1.0], np.full(len(pos), open_rad))
    axis, hinge = axis_of(pos, quat), hinge_of(pos, quat)
    turned = axis + poses.rotate(down, held - axis)
    turned_quat = down * poses.rotation(grasp)
    opened = hinge + poses.rotate(swing, turned - hinge)
    return (held, grasp), (turned, poses.quat(turned_quat)), (opened, poses.quat(swing * turned_quat))


def _follows(scene: Scene, start: Array, way: list[tuple[Array, Array]]) -> bool:
    before = start
    for pos, quat in way:
        found = reach(scene, pos, quat, starts=(before,), restarts=0)
        if found is None or np.abs(found - before).max() > BRANCH_RAD:
            return False
        before = found
    return True
