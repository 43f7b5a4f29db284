"""The second opinion: options and policies, unchanged, in robosuite's own environments with its own controller.

Nothing of ours does the physics set-up or the control there: robosuite composes and steps its unmodified environment,
its OSC_POSE controller at 20 Hz turns the target pose of an option into torques, its gripper controller moves the
fingers, and its own `_check_success` judges. What is ours: the option's target, from an observation with the
columns of our world that is read from robosuite's simulation.

robosuite has no shelf. `worlds.robosuite.shelf` adds one, written as its own environments are; physics and control are
robosuite's there too, but scene and `_check_success` are ours, so it is left out of `known_tasks`, whose environments
are unmodified.

`make(world)` gives a `TransferWorld`, which keeps the contract of a world, so that whatever runs in one of ours
(chains, the runner, a recovery policy) runs in robosuite's. It holds one environment and thus one row at a time.
"""

from p2l.worlds.robosuite.environments import known_tasks, task_of
from p2l.worlds.robosuite.gains import Gains
from p2l.worlds.robosuite.transfer import TransferWorld, Tuning, execute, make

__all__ = ["Gains", "TransferWorld", "Tuning", "execute", "known_tasks", "make", "task_of"]
