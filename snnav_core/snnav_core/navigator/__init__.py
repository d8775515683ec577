"""One decision step: from area, robots and goals to certified paths."""
