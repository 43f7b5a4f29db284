"""The learners that are compared: RC, Lazy RC, PP and RL; `table` lists them."""
