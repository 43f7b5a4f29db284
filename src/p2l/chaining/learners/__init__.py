"""The learners that are compared: RC, Lazy RC, PP, RL and search; `table` lists them."""
