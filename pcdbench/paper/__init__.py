"""A publication's experiments, run again: its tables and figures, ours beside the published numbers."""
