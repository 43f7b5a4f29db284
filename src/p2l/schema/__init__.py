"""What each stage's configuration may hold: types, ranges, and one message that names every wrong key.

Hydra composes, this validates: unknown keys are refused and every number has a range. One model per stage; a value is
read by the stage of the same name, so a field lives where it is used. `resolve` turns a composed Hydra configuration
into plain data, `validate` turns plain data into a frozen model.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import get_args

from p2l.schema.base import ArchivedStageConfig, StageConfig, resolve, validate
from p2l.schema.chains import ChainRecoveriesConfig, EvaluateChainsConfig, ExportConfig
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

SCHEMAS: Mapping[str, type[StageConfig]] = {
    "collect": CollectConfig,
    "fit_transfer": FitTransferConfig,
    "plan": PlanConfig,
    "check_plan": CheckPlanConfig,
    "predict_transfer": PredictTransferConfig,
    "ask": AskConfig,
    "evaluate_team": EvaluateTeamConfig,
    "fit_preconditions": FitPreconditionsConfig,
    "discover": DiscoverConfig,
    "cluster": ClusterConfig,
    "learn_recoveries": LearnRecoveriesConfig,
    "evaluate_recoveries": EvaluateRecoveriesConfig,
    "iterate_recoveries": IterateRecoveriesConfig,
    "chain_recoveries": ChainRecoveriesConfig,
    "evaluate_chains": EvaluateChainsConfig,
    "export": ExportConfig,
    "watch": WatchConfig,
    "report": ReportConfig,
    "config": ConfigStageConfig,
}

PATHS = frozenset(
    name
    for schema in SCHEMAS.values()
    for name, field in schema.model_fields.items()
    if field.annotation is Path or Path in get_args(field.annotation)
)  # fields that name a file or a folder

__all__ = [
    "PATHS",
    "SCHEMAS",
    "ArchivedStageConfig",
    "AskConfig",
    "ChainRecoveriesConfig",
    "CheckPlanConfig",
    "ClusterConfig",
    "CollectConfig",
    "ConfigStageConfig",
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
    "resolve",
    "validate",
]
