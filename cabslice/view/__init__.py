"""Pictures. The one doorway to matplotlib."""
