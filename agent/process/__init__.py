"""The process around the mind: options, bus, health, kernels made ready."""
