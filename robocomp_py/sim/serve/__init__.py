"""A component that simulates a scene, and provides the interfaces of its robots and sensors."""
