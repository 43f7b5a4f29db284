"""Recoveries: which to learn next, and how they are learnt."""
