"""``unspoken bench``: how fast and how good decisions are on this machine; one module a section."""
