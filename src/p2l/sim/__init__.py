"""MuJoCo, and nothing but MuJoCo: models with impedance inside, and a batched engine that remembers nothing."""
