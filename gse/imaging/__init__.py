"""Images to panoramas: files read, blobs found, objects extracted; and the camera fitted to the stars of a session."""
