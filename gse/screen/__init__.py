"""A screen as sky: the page that shows the stars, and the stage that says which and when."""
