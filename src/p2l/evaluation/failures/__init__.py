"""Failure modes: tables, figures and their section of the report."""
