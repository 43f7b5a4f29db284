"""The nut in thirteen numbers: the hand from the nut, the fingers, and the nut from the peg.

The hand's position is relative to the nominal grasp in the nut's frame, its turn relative to the nominal grasp's
orientation. Of the fingers three gaps are told apart: closed on nothing, around the handle, open. The nut's tilt is a
rotation vector without its part about the vertical, after the nut's yaw; its yaw counts from the nearest quarter turn.

Axis letters: N rows.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from p2l import poses
from p2l.contracts.observation import Observation, Privileged
from p2l.records import Array, BoolArray
from p2l.worlds.nut.geometry import NUT_HALF_M, TABLE_M, UP, grasp_pose, yaw_of, yaw_off

GAPS_M = np.array([0.0, 0.032, 0.08])  # what stands for the three
EMPTY_BELOW_M, OPEN_ABOVE_M = 0.02, 0.05
CLOSED_BELOW_M = 0.056  # between the last two
AT_PEG_M = 0.05  # a nut that far from the peg has nothing to do with it


class NutSymbols:
    """See `contracts.symbols.Symbols`.

    Args:
        finger_sign: which way round the fingers grasp, +1 or −1.
    """

    names = (
        *(f"grip_from_grasp_m[{axis}]" for axis in "xyz"),
        *(f"grip_turn_rad[{axis}]" for axis in "xyz"),
        "finger_gap_m",
        *(f"nut_from_peg_m[{axis}]" for axis in "xyz"),
        *(f"nut_tilt_rad[{axis}]" for axis in "xy"),
        "nut_yaw_rad",
    )
    context = (0, 1, 2, 3, 4, 5, 7, 8, 9)
    things = (7, 8, 9, 10, 11, 12)
    far = np.array([0.03, 0.03, 0.03, 0.2, 0.2, 0.2, 0.0, 0.02, 0.02, 0.03, 0.2, 0.2, 0.2])

    def __init__(self, finger_sign: float) -> None:
        self.finger_sign = finger_sign
        origin, identity = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]])
        self._nominal = poses.rotation(grasp_pose(origin, identity, finger_sign)[1])

    def state(self, source: Privileged | Observation) -> Array:
        """Hand from nut, fingers, nut from peg."""
        quat = source["nut_quat"]
        nut, yaw = poses.rotation(quat), yaw_of(quat)
        grasp, _ = grasp_pose(source["nut_pos_m"], quat, self.finger_sign)
        away = poses.rotate(nut.inv(), source["grip_pos_m"] - grasp)
        turn = (nut.inv() * poses.rotation(source["grip_quat"]) * self._nominal.inv()).as_rotvec()
        gap = GAPS_M[np.digitize(source["gap_m"], [EMPTY_BELOW_M, OPEN_ABOVE_M])]
        tilt = (poses.about(UP, -yaw) * nut).as_rotvec()[:, :2]
        return np.concatenate([away, turn, gap, source["nut_from_peg_m"], tilt, yaw_off(quat)[:, None]], axis=1)

    def hand(self, source: Privileged | Observation, state: Array) -> tuple[Array, Array]:
        """Puts the nut where it is in `state`; one that lies away from the peg there stays where it is, laid flat."""
        state = np.array(state)  # scipy reads only arrays that it could write to
        yaw = yaw_of(source["nut_quat"])
        quarter = yaw - yaw_off(source["nut_quat"])
        at_peg = np.linalg.norm(state[:, 7:9], axis=1) < AT_PEG_M
        closed = self.fingers_closed(state)
        tilt = Rotation.from_rotvec(np.column_stack([state[:, 10:12], np.zeros(len(state))]))
        nut = poses.about(UP, np.where(at_peg, quarter + state[:, 12], yaw)) * tilt
        lying = np.column_stack([source["nut_pos_m"][:, :2], np.full(len(state), TABLE_M + NUT_HALF_M)])
        there = np.where(closed[:, None], source["nut_pos_m"], lying)
        pos = np.where(at_peg[:, None], source["peg_pos_m"] + state[:, 7:10], there)
        quat = poses.quat(nut)
        grasp, _ = grasp_pose(pos, quat, self.finger_sign)
        turned = nut * Rotation.from_rotvec(state[:, 3:6]) * self._nominal
        return grasp + poses.rotate(nut, state[:, :3]), poses.quat(turned)

    def fingers_closed(self, state: Array) -> BoolArray:
        """By the gap."""
        return np.asarray(state[:, 6] < CLOSED_BELOW_M)
