"""Suites: sets of scenarios that are driven together."""
