"""From an image to a panorama: files read, blobs found, objects extracted. May import no room above itself."""
