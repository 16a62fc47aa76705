"""The real-time solver: structured sequential quadratic programming in compiled kernels.

From the outside in: ``solver`` iterates; ``sequential`` writes the quadratic program about a trajectory,
follows its solution and says how that moves with the goals; ``qp`` solves it, by steps from ``kkt`` with
``factorisation``; ``cost`` and ``distances`` are what the program is made of, and ``profiles`` the variables
in which all of it is written, with the limits.
"""
