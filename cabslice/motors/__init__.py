"""What the drives are told."""
