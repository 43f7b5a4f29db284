"""Measurements on the spot: `python -m benchmarks.<name> [--json FILE]`. Ratios are taken within one run."""
