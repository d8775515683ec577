"""Paths through the unoccupied area, and their independent check."""
