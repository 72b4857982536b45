"""The demonstration: a generated factory hall, and a tablet, an admin and a robot who talk to a real service.

Everything here is a client of the public HTTP API, with a scene of its own making and a seed.
"""
