"""What every process here does: end well, be watched, talk to the service manager, refuse with a sentence."""
