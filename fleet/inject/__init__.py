"""Faults brought about: in virtual time, and between and in real processes, by the same rules."""
