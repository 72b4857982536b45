"""Scale as a hypothesis with evidence: who says what, and what is believed (findings on drawings)."""
