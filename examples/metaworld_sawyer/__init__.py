"""Meta-World's Sawyer arm with the policies that come with it."""
