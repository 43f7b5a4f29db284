"""The door in nine numbers: the hand in the lever's frame, the fingers, and how far lever and door are turned.

The lever's frame has its origin at the handle's position, x from the axis to the tip, y into the door, z across. The
geometry of the nominal handle is assumed, whatever the handle, as by the nominal skills. Of the fingers only three
gaps are told apart, since how far they close on a lever is its thickness, which differs from door to door: closed on
nothing, around something, open.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray
from p2l.sim.scene import FINGER_OPEN_M
from p2l.worlds.door.handles import axis_of, grasp_pose, hinge_of

UP = np.array([0.0, 0.0, 1.0])
EMPTY_BELOW_M, OPEN_ABOVE_M = 0.006, 0.065
GAPS_M = np.array([0.0, 0.02, 0.08])  # what stands for the three
CLOSED_BELOW_M = 1.5 * FINGER_OPEN_M  # three quarters of the widest opening


class DoorSymbols:
    """See `contracts.symbols.Symbols`.

    Args:
        finger_sign: which way round the fingers grasp, +1 or −1.
    """

    names = (
        *(f"grip_from_handle_m[{axis}]" for axis in "xyz"),
        *(f"grip_turn_rad[{axis}]" for axis in "xyz"),
        "finger_gap_m",
        "hinge_rad",
        "latch_rad",
    )
    context = (0, 1, 2, 3, 4, 5)
    things = (7, 8)
    far = np.array([0.03, 0.03, 0.03, 0.2, 0.2, 0.2, 0.0, 0.0, 0.0])

    def __init__(self, finger_sign: float) -> None:
        origin, identity = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
        self._nominal = poses.rotation(grasp_pose(origin, identity, finger_sign)[1])

    def state(self, source: Privileged | Observation) -> Array:
        """Position and rotation vector of the hand, from the handle and from the nominal grasp's orientation."""
        lever = poses.rotation(source["handle_quat"]).inv()
        away = poses.rotate(lever, source["grip_pos_m"] - source["handle_pos_m"])
        turn = (lever * poses.rotation(source["grip_quat"]) * self._nominal.inv()).as_rotvec()
        gap = GAPS_M[np.digitize(source["gap_m"], [EMPTY_BELOW_M, OPEN_ABOVE_M])]
        return np.concatenate([away, turn, gap, source["hinge_rad"], source["latch_rad"]], axis=1)

    def hand(self, source: Privileged | Observation, state: Array) -> tuple[Array, Array]:
        """Turns the lever about its axis and the door about its hinge until both are as in `state`."""
        state = np.array(state)  # scipy reads only arrays that it could write to
        pos, lever = source["handle_pos_m"], poses.rotation(source["handle_quat"])
        latch = poses.about(poses.rotate(lever, [0.0, 1.0, 0.0]), state[:, 8] - source["latch_rad"][:, 0])
        hinge = poses.about(UP, state[:, 7] - source["hinge_rad"][:, 0])
        axis, post = axis_of(pos, source["handle_quat"]), hinge_of(pos, source["handle_quat"])
        pos = post + poses.rotate(hinge, axis + poses.rotate(latch, pos - axis) - post)
        lever = hinge * latch * lever
        quat = lever * Rotation.from_rotvec(state[:, 3:6]) * self._nominal
        return pos + poses.rotate(lever, state[:, :3]), poses.quat(quat)

    def fingers_closed(self, state: Array) -> BoolArray:
        """By the gap."""
        return np.asarray(state[:, 6] < CLOSED_BELOW_M)
