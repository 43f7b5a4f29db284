"""Experiment tracking with MLflow: runs that survive a kill, and stores that fail before compute or not at all."""

from p2l.tracking.about import RunCard
from p2l.tracking.runs import RUN_FILE, Tracker, open_sweep, start
from p2l.tracking.store import default_store, safe_uri

__all__ = ["RUN_FILE", "RunCard", "Tracker", "default_store", "open_sweep", "safe_uri", "start"]
