"""HTTP and nothing else: routes, schemas, problems, keys, downloads."""
