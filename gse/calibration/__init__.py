"""The camera and its hot pixels, fitted to the stars of a session. May not import station, assessment or above."""
