"""Layers and the beads that fill them. The one doorway to manifold3d."""
