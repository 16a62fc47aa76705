"""The experimenter's bench: command line, launching, recording, summaries and pictures."""
