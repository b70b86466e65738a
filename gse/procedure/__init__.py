"""A test by a procedure: the supply of the sensor."""
