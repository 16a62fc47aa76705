"""Drive: from a plan to the command of this step, and when not to follow the plan."""
