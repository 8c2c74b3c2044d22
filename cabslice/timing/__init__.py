"""How fast may the robot follow the path? The one doorway to toppra."""
