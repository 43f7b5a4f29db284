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
    fewest = list(range(len(pos)))
    for sign in (1.0, -1.0):
        grasp_pos, grasp_quat, into = grasp_pose(pos, quat, sign)
        start = reach(scene, (grasp_pos - START_AWAY_M * into)[0], grasp_quat[0])
        if start is None:
            continue
        ways = _ways(pos, quat, grasp_pos, grasp_quat, into, open_rad)
        paths = [[(pos[row], quat[row]) for pos, quat in ways] for row in range(len(pos))]
        unreachable = [row for row, path in enumerate(paths) if not _follows(scene, start, path)]
        if not unreachable:
            return sign, start
        fewest = min(fewest, unreachable, key=len)
    return fewest


def hold_posture(scenes: Sequence[Scene], start: Array) -> None:
    """Weak springs draw the arm's joints to `start` [J], rad.

    The models change in place: the start follows from where an engine has the handles.
    """
    for scene in scenes:
        for name, rest in zip(scene.arm_joints, start, strict=True):
            joint = scene.model.joint(name)
            scene.model.jnt_stiffness[joint.id] = POSTURE_NM
            scene.model.qpos_spring[joint.qposadr[0]] = rest


def _ways(
    pos: Array, quat: Array, grasp_pos: Array, grasp_quat: Array, into: Array, open_rad: float
) -> tuple[tuple[Array, Array], ...]:
    """Poses of the hand at the grasp, at the end of the handle's turn, and at the open door."""
    down = poses.about(into, np.full(len(pos), np.pi / 2))
    swing = poses.about([0.0, 0.0, 1.0], np.full(len(pos), open_rad))
    axis, hinge = axis_of(pos, quat), hinge_of(pos, quat)
    turn_pos = axis + poses.rotate(down, grasp_pos - axis)
    turn_quat = down * poses.rotation(grasp_quat)
    open_pos = hinge + poses.rotate(swing, turn_pos - hinge)
    return (grasp_pos, grasp_quat), (turn_pos, poses.quat(turn_quat)), (open_pos, poses.quat(swing * turn_quat))


def _follows(scene: Scene, start: Array, way: list[tuple[Array, Array]]) -> bool:
    before = start
    for pos, quat in way:
        posture = reach(scene, pos, quat, starts=(before,), restarts=0)
        if posture is None or np.abs(posture - before).max() > BRANCH_RAD:
            return False
        before = posture
    return True
