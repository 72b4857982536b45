"""The HTTP process of Groundplan, and the kernel that it shares with the worker."""
