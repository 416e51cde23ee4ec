"""Completing a user's scan, whatever its size: tiles, density, confidence, and what to scan again."""

from pcdbench.completion.completed import Completed
from pcdbench.completion.completing import CompletionWarning, complete

__all__ = ["Completed", "CompletionWarning", "complete"]
