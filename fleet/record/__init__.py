"""What a run leaves: its stream of messages, recording, summary and picture."""
