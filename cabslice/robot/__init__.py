"""The cable robot as pure arrays: poses in; lengths, wrenches, tensions and stiffness out. No meshes, layers, files."""
