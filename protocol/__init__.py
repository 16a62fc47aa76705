"""The wire: what robots, world and bench say to each other, and all that they have to read alike.

Keys, messages and their codec, the version; sessions, who may do what, and how a name is proven; the public
scene with the rules that hold for all (limits, arrival), and the scenario file that it comes from.
"""
