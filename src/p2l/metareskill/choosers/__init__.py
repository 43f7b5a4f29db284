"""Rules that choose the recovery to train next; `choose` is their contract."""
