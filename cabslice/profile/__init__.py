"""Printers, materials and processes as files: read, checked, found by name."""
