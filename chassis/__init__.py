"""What every process of ours does: begin and end well, be watched, read its files, refuse with a sentence."""
