"""Mode sequences placed among obstacles: where to reshape, and how to drive there."""
