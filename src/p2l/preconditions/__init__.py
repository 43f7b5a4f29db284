"""Where a skill works: collected transfer data, and the model that predicts it."""
