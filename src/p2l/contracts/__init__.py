"""What a world, a domain, an option, an observation, an estimator and a symbol table offer; nothing that does it."""
