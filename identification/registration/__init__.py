"""Point clouds of artefacts, cold and warm, into the thermal error motions of the joint that carried the sensor."""
