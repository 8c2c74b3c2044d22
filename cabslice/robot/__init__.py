"""The cable robot as pure arrays: poses in; lengths, wrenches, tensions and stiffness out. Knows no mesh, layer or file."""
