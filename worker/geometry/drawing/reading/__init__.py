"""What was read from a drawing: walls, what was set aside, and a person's corrections."""
