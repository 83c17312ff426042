"""Finding the physics that was left out: locate, name, model, prove."""
