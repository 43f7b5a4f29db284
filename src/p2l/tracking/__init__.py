"""Experiment tracking with MLflow: runs that survive a kill, and stores that fail before compute or not at all."""

from p2l.tracking.runs import RUN_FILE, RunCard, Tracker, open_sweep, start

__all__ = ["RUN_FILE", "RunCard", "Tracker", "open_sweep", "start"]
