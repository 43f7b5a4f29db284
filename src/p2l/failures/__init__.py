"""Failures of nominal skills: found in simulation, grouped into modes."""
