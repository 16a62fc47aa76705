"""Suites: scenarios that are evaluated together, read from files or made by families."""
