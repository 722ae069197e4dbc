"""File formats, one a module: read into the records of `grainmotion.model` and others, and written from them."""
