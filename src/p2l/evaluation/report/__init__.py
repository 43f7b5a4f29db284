"""The page of everything: what it is made of, where it reads, and one module per part of the thesis."""
