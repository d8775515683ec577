"""From a measurement to what it saw."""
