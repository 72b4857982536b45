"""CAD linework to walls: layers, roles, pairs of lines, units."""
