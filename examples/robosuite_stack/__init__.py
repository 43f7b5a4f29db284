"""robosuite's Stack with hand-written controllers."""
