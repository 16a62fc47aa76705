"""Trials of faults: cases of a suite, made with many seeds, and what has to hold in each."""
