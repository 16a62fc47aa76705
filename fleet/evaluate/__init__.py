"""Evaluations: every scenario of a suite with every method, seed and level of noise, in parallel."""
