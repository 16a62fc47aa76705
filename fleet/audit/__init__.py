"""What a recording shows: its world and its robots repeated from what they were given."""
