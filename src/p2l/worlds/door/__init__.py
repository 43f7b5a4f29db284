"""Open robosuite's door with a latch (thesis, section 4.4)."""
