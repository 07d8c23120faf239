"""InnerModel: a tree of frames, bodies, robots and sensors, read from XML. Needs numpy only."""
