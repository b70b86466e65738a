"""The self-check of an installation: made sessions with known errors, and what the station finds in them."""
