"""Chapter 4's tables, figures and sections of the report."""
