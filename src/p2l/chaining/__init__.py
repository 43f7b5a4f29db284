"""RecoveryChaining: recoveries learnt over primitive actions and terminal nominal options (thesis, chapter 5)."""
