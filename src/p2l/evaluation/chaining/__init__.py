"""Chapter 5's tables, figures and sections of the report."""
