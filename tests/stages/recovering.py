"""The stages of chapter 4 on a small push world: how tests run them, each on what the one before left."""

from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_dir

from examples.push.skills import DOWN, behind
from p2l.manifest import write_manifest
from p2l.schema import SCHEMAS, resolve, validate
from p2l.skills.follow import Follow, Waypoints
from p2l.tracking import RunCard, Tracker, start
from p2l.worlds.table import WORLDS
from stages import cluster, discover, fit_preconditions, learn_recoveries
from tests.metareskill.pushing_back import Seen

ROOT = Path(__file__).resolve().parents[2]
STAGES = {
    "discover": discover,
    "cluster": cluster,
    "fit_preconditions": fit_preconditions,
    "learn_recoveries": learn_recoveries,
}
WORLD = {"name": "push_seen", "params": {"sigma_m": 0.03, "nthread": 1}}
SMALL = {"legs": [6, 6, 6], "settle": [0, 0, 2]}


class PushSeen(Seen):
    """The push world in which the hand's orientation is known, under a name and with nominal skills of its own."""

    def __init__(self, *, estimator="fixed", sigma_m=0.03, nthread=1):
        super().__init__(estimator=estimator, sigma_m=sigma_m, nthread=nthread)
        self.name = WORLD["name"]

    def nominal_options(self):
        """Come alongside by a sideways step, so that a hand that is past the block is lost; then push."""

        def sideways(observation):
            x, z = (observation["target_pos_m"][:, axis] for axis in (0, 2))
            pos = np.stack([x, observation["block_y_m"][:, 0], z], axis=1)
            return Waypoints(pos[:, None], np.tile(DOWN, (len(observation), 1, 1)), np.zeros((len(observation), 1)))

        return Follow("align", sideways, (10,), (3,), behind), super().nominal_options()[1]


WORLDS.register(WORLD["name"], f"{__name__}:PushSeen")


def configured(name, **changes):
    """A stage's configuration on the push world, with values changed; those of sections are added."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose(name, ["experiment=smoke"]))
    if "timing" in plain:
        plain["timing"] = SMALL
    plain |= {"item": "push", "world": WORLD}
    for key, value in changes.items():
        plain[key] = plain[key] | value if key in ("query", "tracking") else value
    return validate(plain, SCHEMAS[name], "test")


def run(name, out, **changes):
    """Run a stage in this process; with a store its run is tracked there."""
    store = changes.pop("store", None)
    cfg = configured(name, **changes, **({"tracking": {"enabled": True, "uri": store}} if store else {}))
    out.mkdir(parents=True, exist_ok=True)
    if store is None:
        STAGES[name].run.__wrapped__(cfg, out, Tracker())
        write_manifest(out)
        return
    card = RunCard(name, cfg.subject, cfg.method, cfg.seed, cfg.model_dump(mode="json"), cfg.hash, "a test")
    with start(card, out, ROOT, uri=store) as track:
        STAGES[name].run.__wrapped__(cfg, out, track)
    write_manifest(out)


def found(folder):
    """What `learn_recoveries` reads, as the stages before left it in `folder`."""
    return {
        "failures": str(folder / "discover" / "failures_train.npz"),
        "held_out": str(folder / "discover" / "failures_held_out.npz"),
        "modes": str(folder / "cluster" / "modes.npz"),
        "preconditions": str(folder / "fit_preconditions" / "preconditions.npz"),
    }


def prepare(folder, **world):
    """Run the stages before `learn_recoveries`."""
    chosen = {"world": WORLD | {"params": WORLD["params"] | world}}
    run("discover", folder / "discover", strategy="pessimistic", executions={"train": 40, "held_out": 32}, **chosen)
    run("fit_preconditions", folder / "fit_preconditions", trajectories=24, samples=48, **chosen)
    files = {name: found(folder)[name] for name in ("failures", "held_out", "preconditions")}
    run("cluster", folder / "cluster", **files, videos=False, **chosen)


def learn(folder, out, **changes):
    """Run `learn_recoveries` on what is in `folder`: 6 recoveries, so 12 initial rounds; nothing works before."""
    settings = {"rounds": 16, "videos": False, "guesses": [], "reported": 0}
    settings["query"] = {"updates": 2, "rollouts": 10, "solved": 0.5, "verify": False}
    run("learn_recoveries", out, **{**found(folder), **settings, **changes})
