"""A small certificate authority for runs across machines, and what it hands out."""
