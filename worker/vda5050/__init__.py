"""Maps for robots that speak VDA 5050: orders to fetch and use a revision, and what vehicles say of it."""
