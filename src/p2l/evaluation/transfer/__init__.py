"""How good the transfer predictor is: scores, figures and their section of the report."""
