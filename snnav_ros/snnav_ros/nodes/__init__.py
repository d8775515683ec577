"""The nodes: convert a message, call the core, publish."""
