"""robosuite's square nut on its peg."""
