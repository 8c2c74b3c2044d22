"""What is best among many: where a part stands."""
