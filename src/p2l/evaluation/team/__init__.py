"""Chapter 3's plans and costs: tables, figures and sections of the report."""
