"""Can this robot follow this path? A no is a value."""
