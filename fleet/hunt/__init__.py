"""The hunt: an optimiser searches the space of scenarios for those that hurt most."""
