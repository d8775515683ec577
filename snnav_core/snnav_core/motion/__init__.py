"""Motion models of the robots."""
