"""The unoccupied area: what the sensor network knows to be free."""
