"""Which stages every item goes through, and the resolved configuration of one stage of one item."""

from __future__ import annotations

from hydra import compose
from hydra.errors import HydraException
from omegaconf import OmegaConf

from p2l.errors import ConfigError
from p2l.schema import SCHEMAS, ConfigStageConfig, resolve, validate

DOMAIN_STAGES = ("collect", "fit_transfer", "plan", "evaluate_team")
WORLD_STAGES = ("discover", "cluster")
RECOVERY_STAGES = ("fit_preconditions", "learn_recoveries", "evaluate_recoveries")
CHAIN_STAGES = ("chain_recoveries", "evaluate_chains")
STAGES = (*DOMAIN_STAGES, *WORLD_STAGES, *RECOVERY_STAGES, *CHAIN_STAGES, "report")
# Where the pipeline asks for more than a person does, whose runs are single ones.
PIPELINE_OVERRIDES = {"chain_recoveries": ("compare=${experiment.chain.learners}", "seeds=${experiment.chain.seeds}")}


def stages_of(cfg: ConfigStageConfig, world: str) -> tuple[str, ...]:
    """What a world goes through."""
    recovery = RECOVERY_STAGES if world in cfg.recovery_worlds else ()
    return (*WORLD_STAGES, *recovery, *(CHAIN_STAGES if world in cfg.chain_worlds else ()))


def choices(cfg: ConfigStageConfig, name: str, world: str) -> list[str]:
    """Overrides of one stage of one world."""
    overrides = [f"world={world}", f"item={world}", f"experiment={cfg.preset}"]
    if name == "cluster" and world in cfg.recovery_worlds:
        overrides.append(f"preconditions=data/fit_preconditions/{world}/preconditions.npz")
    return overrides


def resolved_yaml(cfg: ConfigStageConfig, name: str, overrides: list[str]) -> str:
    """The resolved YAML of one stage of one item, cfg by its schema; Hydra is up already, in `conf/`."""
    overrides = [*overrides, *PIPELINE_OVERRIDES.get(name, ()), f"seed={cfg.seed}", *cfg.overrides.get(name, ())]
    where = f"conf/{name}.yaml with {' '.join(overrides)}"
    try:
        plain = resolve(compose(config_name=name, overrides=overrides))
    except HydraException as error:
        raise ConfigError(f"{where}: {error}") from error
    config = validate(plain, SCHEMAS[name], where)
    return OmegaConf.to_yaml(OmegaConf.create(config.model_dump(mode="json")))
