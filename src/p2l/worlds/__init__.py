"""Task distributions: each world is one file, one YAML and one registry line."""
