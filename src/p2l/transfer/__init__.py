"""What a lesson is worth elsewhere: collected transfer data, and the model that predicts it (thesis, section 3.3.2)."""
