"""The real-time solver: structured sequential quadratic programming in compiled kernels.

From the outside in: ``solver`` iterates; ``sequential`` writes the quadratic program about a trajectory and
follows its solution; ``qp`` solves it, by steps from ``kkt`` with the factorisations of ``stagewise`` and
``cholesky``; ``cost``, ``limits`` and ``distances`` are what the program is made of, and ``profiles`` the
variables in which all of it is written. ``sensitivities`` says how solutions move with the goals.
"""
