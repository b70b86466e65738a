"""Shared by report and live view: colours, and the outline of the field. May import neither of them."""
