"""The large-scale route: facility location by bounds, search and branching (thesis, theorem 3.4.1)."""
