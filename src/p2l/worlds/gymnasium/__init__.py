"""Worlds out of environments that step: Gymnasium-Robotics, Meta-World, robosuite, or one's own."""

from p2l.worlds.gymnasium.adapter import RobosuiteEnv
from p2l.worlds.gymnasium.layout import Noise
from p2l.worlds.gymnasium.options import Controller, HeldAction, box_primitives
from p2l.worlds.gymnasium.world import GymnasiumWorld

__all__ = ["Controller", "GymnasiumWorld", "HeldAction", "Noise", "RobosuiteEnv", "box_primitives"]
