"""Stage `export`: a recovery policy as ONNX, checked against the original."""

from __future__ import annotations

from pathlib import Path

from p2l.chaining.export import CHECKED, FILE, export, recorded_states
from p2l.chaining.policy import load_policy
from p2l.errors import ArtifactError
from p2l.failures.record import load_failures
from p2l.schema import ExportConfig
from p2l.tracking import Tracker
from stages._stage import stage


@stage("export", ExportConfig)
def run(cfg: ExportConfig, out: Path, track: Tracker) -> None:
    """Write policy.onnx and its card."""
    policy = load_policy(cfg.policy)
    path = cfg.failures or Path("data/discover") / policy.card.world / "failures_train.npz"
    if not path.exists():
        raise ArtifactError(f"{path}: no recorded failures to compare the exported policy on; say failures=<file>")
    failures = load_failures(path)
    check = export(out, policy, recorded_states(policy, failures), min(len(failures), CHECKED))
    track.artifact(out / FILE)
    print(
        f"{out / FILE}: {policy.card.learner} of '{policy.card.world}'; on {check.observations} observations "
        f"({check.recorded} recorded, the others drawn around them) logits differ by at most "
        f"{check.largest_difference:.1g}, {check.same_actions:.1%} of the actions are the same"
    )


if __name__ == "__main__":
    run()
