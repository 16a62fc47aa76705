"""Remember: what was seen of everybody, and what of it can be believed."""
