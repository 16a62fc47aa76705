"""What crosses a process boundary, and nothing else.

Messages and their codec, the bus keys, the session settings, the public scene with the rules that every
process has to read in the same way (limits, arrival), the scenario file that an experimenter writes, and
how a process is told to end.
"""
