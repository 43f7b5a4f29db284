"""What each stage's configuration may hold: types, ranges, and one message that names every wrong key.

Hydra composes, this validates: unknown keys are refused and every number has a range. One model per stage; a value is
read by the stage of the same name, so a field lives where it is used. `resolve` turns a composed Hydra configuration
into plain data, `validate` turns plain data into a frozen model. A stage loads its own model and no other.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from p2l.schema.base import ArchivedStageConfig, StageConfig, paths_of, resolve, unknown_key, validate

if TYPE_CHECKING:
    from p2l.schema.chains import ChainRecoveriesConfig, EvaluateChainsConfig, ExportConfig
    from p2l.schema.day import DayConfig
    from p2l.schema.metareskill import (
        EvaluateRecoveriesConfig,
        FitPreconditionsConfig,
        IterateRecoveriesConfig,
        LearnRecoveriesConfig,
    )
    from p2l.schema.pipeline import ConfigStageConfig, ReportConfig
    from p2l.schema.prediction import PredictTransferConfig
    from p2l.schema.preferences import AskConfig
    from p2l.schema.recovery import ClusterConfig, DiscoverConfig, WatchConfig
    from p2l.schema.team import CheckPlanConfig, CollectConfig, EvaluateTeamConfig, FitTransferConfig, PlanConfig

_HOMES = {  # module → stage → model
    "chains": {
        "chain_recoveries": "ChainRecoveriesConfig",
        "evaluate_chains": "EvaluateChainsConfig",
        "export": "ExportConfig",
    },
    "day": {"day": "DayConfig"},
    "metareskill": {
        "fit_preconditions": "FitPreconditionsConfig",
        "learn_recoveries": "LearnRecoveriesConfig",
        "evaluate_recoveries": "EvaluateRecoveriesConfig",
        "iterate_recoveries": "IterateRecoveriesConfig",
    },
    "pipeline": {"report": "ReportConfig", "config": "ConfigStageConfig"},
    "preferences": {"ask": "AskConfig"},
    "prediction": {"predict_transfer": "PredictTransferConfig"},
    "recovery": {"discover": "DiscoverConfig", "cluster": "ClusterConfig", "watch": "WatchConfig"},
    "team": {
        "collect": "CollectConfig",
        "fit_transfer": "FitTransferConfig",
        "plan": "PlanConfig",
        "check_plan": "CheckPlanConfig",
        "evaluate_team": "EvaluateTeamConfig",
    },
}
_HOME_OF = {model: home for home, models in _HOMES.items() for model in models.values()}
_MODEL_OF = {stage: model for models in _HOMES.values() for stage, model in models.items()}


def __getattr__(name: str) -> Any:
    """Import a model when it is asked for (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'p2l.schema' has no attribute '{name}'")
    model = getattr(importlib.import_module(f"p2l.schema.{_HOME_OF[name]}"), name)
    globals()[name] = model
    return model


class _Schemas(Mapping[str, type[StageConfig]]):
    """The model of each stage, loaded when it is asked for."""

    def __getitem__(self, stage: str) -> type[StageConfig]:
        model: type[StageConfig] = __getattr__(_MODEL_OF[stage])
        return model

    def __iter__(self) -> Iterator[str]:
        return iter(_MODEL_OF)

    def __len__(self) -> int:
        return len(_MODEL_OF)


SCHEMAS: Mapping[str, type[StageConfig]] = _Schemas()

__all__ = [
    "SCHEMAS",
    "ArchivedStageConfig",
    "AskConfig",
    "ChainRecoveriesConfig",
    "CheckPlanConfig",
    "ClusterConfig",
    "CollectConfig",
    "ConfigStageConfig",
    "DayConfig",
    "DiscoverConfig",
    "EvaluateChainsConfig",
    "EvaluateRecoveriesConfig",
    "EvaluateTeamConfig",
    "ExportConfig",
    "FitPreconditionsConfig",
    "FitTransferConfig",
    "IterateRecoveriesConfig",
    "LearnRecoveriesConfig",
    "PlanConfig",
    "PredictTransferConfig",
    "ReportConfig",
    "StageConfig",
    "WatchConfig",
    "paths_of",
    "resolve",
    "unknown_key",
    "validate",
]
