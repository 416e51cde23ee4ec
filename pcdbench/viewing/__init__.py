"""Clouds for people to look at: a page that turns and zooms, and what notebooks show."""
