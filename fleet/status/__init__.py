"""``unspoken status``: how the processes of a run are, while it goes on."""
