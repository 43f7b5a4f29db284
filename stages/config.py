"""Stage `config`: compose, validate and write the configuration of every stage of every item.

DVC watches the written files, whole, as params of the stages that read them: what Hydra resolves is what reruns.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from p2l.artifacts import write_text
from p2l.errors import ConfigError
from p2l.schema import ConfigStageConfig
from p2l.tracking import Tracker
from stages import ROOT
from stages._composition import DOMAIN_STAGES, STAGES, choices, resolved_yaml, stages_of
from stages._stage import stage


@stage("config", ConfigStageConfig)
def run(cfg: ConfigStageConfig, out: Path, track: Tracker) -> None:  # noqa: ARG001
    """Write `out/<item>/<stage>.yaml`; items are domains, worlds and the report. All must be valid before."""
    if unknown := sorted(set(cfg.overrides) - set(STAGES)):
        raise ConfigError(f"overrides: unknown stages {unknown}; presets: {', '.join(STAGES)}")
    if not (ROOT / "conf" / "experiment" / f"{cfg.preset}.yaml").is_file():
        presets = sorted(path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml"))
        raise ConfigError(f"preset: given '{cfg.preset}'; allowed: {', '.join(presets)}")
    texts = {
        f"{domain}/{name}": resolved_yaml(cfg, name, [f"domain={domain}", f"experiment={cfg.preset}"])
        for domain in cfg.domains
        for name in DOMAIN_STAGES
    }
    texts |= {
        f"{world}/{name}": resolved_yaml(cfg, name, choices(cfg, name, world))
        for world in cfg.worlds
        for name in stages_of(cfg, world)
    }
    kinds = ("domains", "worlds", "cluster_worlds", "recovery_worlds", "chain_worlds")
    items = [f"{kind}=[{','.join(getattr(cfg, kind))}]" for kind in kinds]
    texts["report/report"] = resolved_yaml(cfg, "report", [f"preset={cfg.preset}", *items])
    write(out, texts)


def write(out: Path, texts: Mapping[str, str]) -> None:
    """Replace the items of `out` by `texts`; a file that says the same stays as it is."""
    for item in [path for path in out.iterdir() if path.is_dir()]:
        if not any(key.startswith(f"{item.name}/") for key in texts):
            shutil.rmtree(item)
    for key, text in texts.items():
        path = out / f"{key}.yaml"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            write_text(path, text)


if __name__ == "__main__":
    run()
