"""The database: models, sessions, and the only SQL of the product."""
