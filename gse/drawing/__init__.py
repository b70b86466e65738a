"""What the report and the live view draw alike: colours, and the outline of the field. May import neither of them."""
