"""Films of a model: along a camera path, to a video or to numbered pictures."""
