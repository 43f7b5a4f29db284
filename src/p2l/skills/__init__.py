"""What a robot can do: skills, how a batch of rows executes them, and how one is learnt by policy search."""
