"""What the process needs of Python and its libraries: its own packages, a quick start, little memory, safe output."""
