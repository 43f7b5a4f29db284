"""A made-up shop: its tasks, what was tried, and a day's orders."""
