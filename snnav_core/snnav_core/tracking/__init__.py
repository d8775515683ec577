"""Following a path: from path and pose to turn rate."""
