"""Files that the program reads, made up; spoilt ones, and commands that are stopped."""
