"""Stage `config`: compose, validate and write the configuration of every stage of every item.

DVC watches the written files, whole, as params of the stages that read them: what Hydra resolves is what reruns.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from hydra import compose
from hydra.errors import HydraException
from omegaconf import OmegaConf

from p2l.artifacts import write_text
from p2l.errors import ConfigError
from p2l.schema import SCHEMAS, ConfigStageConfig, resolve, validate
from p2l.tracking import Tracker
from stages import ROOT
from stages._stage import stage

DOMAIN_STAGES = ("collect", "fit_transfer", "plan", "evaluate_team")
WORLD_STAGES = ("discover", "cluster")
RECOVERY_STAGES = ("fit_preconditions", "learn_recoveries", "evaluate_recoveries")
CHAIN_STAGES = ("chain_recoveries", "evaluate_chains")
STAGES = (*DOMAIN_STAGES, *WORLD_STAGES, *RECOVERY_STAGES, *CHAIN_STAGES, "report")
# Where the pipeline asks for more than a person does, whose runs are single ones.
ASKED = {"chain_recoveries": ("compare=${experiment.chain.learners}", "seeds=${experiment.chain.seeds}")}


@stage("config", ConfigStageConfig)
def run(cfg: ConfigStageConfig, out: Path, track: Tracker) -> None:  # noqa: ARG001
    """Write `out/<item>/<stage>.yaml`; items are domains, worlds and the report. All must be valid before."""
    if unknown := sorted(set(cfg.overrides) - set(STAGES)):
        raise ConfigError(f"overrides: unknown stages {unknown}; allowed: {', '.join(STAGES)}")
    if not (ROOT / "conf" / "experiment" / f"{cfg.preset}.yaml").is_file():
        allowed = sorted(path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml"))
        raise ConfigError(f"preset: given '{cfg.preset}'; allowed: {', '.join(allowed)}")
    texts = {
        f"{domain}/{name}": composed(cfg, name, [f"domain={domain}", f"experiment={cfg.preset}"])
        for domain in cfg.domains
        for name in DOMAIN_STAGES
    }
    texts |= {
        f"{world}/{name}": composed(cfg, name, choices(cfg, name, world))
        for world in cfg.worlds
        for name in stages_of(cfg, world)
    }
    kinds = ("domains", "worlds", "cluster_worlds", "recovery_worlds", "chain_worlds")
    items = [f"{kind}=[{','.join(getattr(cfg, kind))}]" for kind in kinds]
    texts["report/report"] = composed(cfg, "report", [f"preset={cfg.preset}", *items])
    write(out, texts)


def stages_of(cfg: ConfigStageConfig, world: str) -> tuple[str, ...]:
    """What a world goes through."""
    recovery = RECOVERY_STAGES if world in cfg.recovery_worlds else ()
    return (*WORLD_STAGES, *recovery, *(CHAIN_STAGES if world in cfg.chain_worlds else ()))


def choices(cfg: ConfigStageConfig, name: str, world: str) -> list[str]:
    """Overrides of one stage of one world."""
    chosen = [f"world={world}", f"item={world}", f"experiment={cfg.preset}"]
    if name == "cluster" and world in cfg.recovery_worlds:
        chosen.append(f"preconditions=data/fit_preconditions/{world}/preconditions.npz")
    return chosen


def composed(cfg: ConfigStageConfig, name: str, chosen: list[str]) -> str:
    """The resolved YAML of one stage of one item, checked by its schema; Hydra is up already, in `conf/`."""
    overrides = [*chosen, *ASKED.get(name, ()), f"seed={cfg.seed}", *cfg.overrides.get(name, ())]
    where = f"conf/{name}.yaml with {' '.join(overrides)}"
    try:
        plain = resolve(compose(config_name=name, overrides=overrides))
    except HydraException as error:
        raise ConfigError(f"{where}: {error}") from error
    checked = validate(plain, SCHEMAS[name], where)
    return OmegaConf.to_yaml(OmegaConf.create(checked.model_dump(mode="json")))


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
