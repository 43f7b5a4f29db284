"""Failure rounds: discover what is still lost, and learn on."""
