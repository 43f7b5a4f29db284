"""Nominal skills, one file for each world."""
