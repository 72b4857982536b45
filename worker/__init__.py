"""The background process of Groundplan, its geometry, and the `groundplan` command."""
