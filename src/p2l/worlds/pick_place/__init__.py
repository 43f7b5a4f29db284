"""Bread from one bin into its quarter of another (thesis, section 5.4.1)."""
