"""Session files: written so that a killed process loses nothing, read whatever was done to them. MCAP inside."""
