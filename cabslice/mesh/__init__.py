"""Meshes: loaded, mended, placed on the bed. The one doorway to trimesh."""
